"""Normals that the light acts on: those of the mesh, without the noise that the photos contradict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Stage, counted
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.relief.settings import ShadingNormalSettings
from stages.scene.distributions import OPEN3D, PICTURES
from stages.scene.memory_of_views import BYTES_OF_LIBRARIES, FEWER_OR_SMALLER_VIEWS

if TYPE_CHECKING:
    import numpy as np

    from stages.formats.artefacts.transfer_file import StoredTransfer
    from stages.formats.meshes.triangle_meshes import Surface
    from stages.photometry.light_search.light_estimate import LightEstimate
    from stages.photometry.relief.photo_on_mesh import OnMesh
    from stages.photometry.relief.vertex_smoothing import VertexSmoothing
    from stages.photometry.transport.lit_scenes import LitScene
    from stages.scene.cameras import Camera

ROUGH = LightingSettings()  # of the rough light; where its defaults change, the version does
BYTES_PER_PIXEL = 400  # of the views that the rough light is estimated from
BYTES_PER_BYTE_OF_MESH = 25  # of its file


@dataclass(frozen=True, eq=False)
class Rough:
    """A rough light and what it was estimated with; no light where the views do not share one."""

    scene: LitScene
    light: LightEstimate | None
    on_mesh: OnMesh


def run(job: Job[ShadingNormalSettings]) -> None:
    """Estimate a rough light, weaken the relief that the photos contradict, and save the views' normals."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.artefacts.transfer_file import read_transfer
    from stages.formats.meshes.triangle_meshes import read_mesh
    from stages.geometry.rays import vertex_normals
    from stages.photometry.relief.photo_on_mesh import write_normals
    from stages.photometry.relief.vertex_smoothing import VertexSmoothing
    from stages.solvers.kernels.threading_layer import use_threads

    use_threads(job.threads)
    cameras, mesh = read_cameras(job.inputs["cameras"]), read_mesh(job.inputs["mesh"])
    stored = read_transfer(job.inputs["transfer"])
    stored = replace(stored, radii=stored.radii[:1], visible=stored.visible[:1])  # light from infinity
    how = job.settings.relief
    smoothing = VertexSmoothing.of(mesh.faces, len(mesh.vertices), how.steps, how.wider)
    levels = smoothing.normals(vertex_normals(mesh.vertices, mesh.faces))
    normals, shares = levels[0], list[float]()
    rough = _rough_light(job, cameras, mesh, stored, levels[:2])
    if rough.light is not None:
        normals, shares = _supported(job, rough, rough.light, mesh, stored, smoothing, levels)
    to = job.outputs["shading_normal"]
    with job.progress("views", len(cameras)) as step:
        written = job.tasks.small(write_normals, cameras, dict(job.inputs), normals, mesh.faces, to)
        turned = list(counted(written, step))
    job.note(turned_deg=round(median(turned), 2), kept_of_bands=[round(share, 3) for share in shares])


def _rough_light(
    job: Job[ShadingNormalSettings],
    cameras: list[Camera],
    mesh: Surface,
    stored: StoredTransfer,
    levels: list[np.ndarray],
) -> Rough:
    """Estimate light from infinity from some views, on the mesh's normals or slightly smoothed ones.

    Whichever lets pairs of equal albedo disagree less: noise of stereo can hide a sun.
    """
    import numpy as np

    from stages.formats.artefacts.view_files import read_surface_points
    from stages.geometry.vertex_interpolation import pixels_on_proxy
    from stages.photometry.clusters.cluster_views import view_graph
    from stages.photometry.clusters.surface_clusters import Cluster
    from stages.photometry.clusters.typical_views import typical_views
    from stages.photometry.lighting.illumination import ObservationsWithGains
    from stages.photometry.lighting.opened_views import ViewFiles, gains_of_all
    from stages.photometry.relief.photo_on_mesh import OnMesh, normals_at
    from stages.photometry.transport.lit_scenes import scenes_by_distance

    graph = view_graph(job.inputs, cameras)
    files = ViewFiles(dict(job.inputs), cameras, graph.side, ROUGH.trusted_pixels)
    some = list(typical_views(graph, job.settings.pixels))
    opened = files.open(Cluster.whole(some, graph.pixels[some].sum()), None, job.executor.map)
    gains = gains_of_all(job, files, opened.scale, ROUGH.gains)
    points = read_surface_points(job.inputs, opened.views.cameras, opened.views.masks)
    at, faces = (np.concatenate(part) for part in (points[1], points[0]))
    blend, scenes = pixels_on_proxy(stored, mesh, points), []
    for level in levels:
        own = normals_at(level, mesh.faces[faces], at, opened.normals)
        scenes += scenes_by_distance(stored, blend, own)[0]
    seen = opened.views.stack, opened.images, opened.viewing
    photos = ObservationsWithGains.of(*seen, ROUGH, gains[some]).lit.reflecting(ROUGH.reflectance.usual)
    on_mesh = OnMesh(files, mesh.faces, len(mesh.vertices), opened.scale, gains, ROUGH.pairs)
    if photos.apart:
        return Rough(scenes[0], None, on_mesh)
    with job.progress("light", len(scenes) * len(ROUGH.search.scales)) as step:
        lights = [photos.light(scene, step) for scene in scenes]
    best = int(np.argmin(photos.disagreements(scenes, lights)))
    return Rough(scenes[best], lights[best], on_mesh)


def _supported(
    job: Job[ShadingNormalSettings],
    rough: Rough,
    light: LightEstimate,
    mesh: Surface,
    stored: StoredTransfer,
    smoothing: VertexSmoothing,
    levels: list[np.ndarray],
) -> tuple[np.ndarray, list[float]]:
    """Weaken the relief that the photos of all views contradict under the rough light."""
    from stages.geometry.vertex_interpolation import blend_matrix
    from stages.photometry.relief.lit_vertices import LitVertices
    from stages.photometry.relief.photo_on_mesh import photo_on_mesh, seen_on_mesh
    from stages.photometry.relief.supported_relief import Cubes, Photo, supported_normals
    from stages.photometry.relief.vertex_smoothing import radii_of, typical_edge

    how, count = job.settings.relief, len(mesh.vertices)
    views = range(len(rough.on_mesh.files.cameras))
    with job.progress("photos", len(views)) as step:
        seen = counted(job.tasks.small(seen_on_mesh, views, rough.on_mesh), step)
        photo = Photo(*photo_on_mesh(seen, count, how.fewest))
    radii = radii_of(smoothing.steps[1:], typical_edge(mesh))
    cubes = [Cubes.of(mesh.vertices, how.window * radius) for radius in radii]
    to_proxy = blend_matrix(stored.corners[:count], stored.weights[:count], len(stored.blocked))
    lit = LitVertices(rough.scene, light, to_proxy, ROUGH.trusted_pixels.unlit)
    return supported_normals(levels, smoothing, cubes, photo, lit.log_shading, how)


def estimated_memory(settings: ShadingNormalSettings, inputs: Mapping[str, Path], threads: int) -> int:
    """Estimate the memory from the mesh, and the pixels that the rough light is estimated from."""
    from stages.formats.artefacts.view_files import masked_pixels

    mesh = BYTES_PER_BYTE_OF_MESH * inputs["mesh"].stat().st_size
    return BYTES_OF_LIBRARIES + mesh + BYTES_PER_PIXEL * min(settings.pixels, masked_pixels(inputs))


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"normals turned by {facts['turned_deg']:.1f}° where the photos contradict the mesh (median)"


SHADING_NORMALS = Stage(
    name="shading_normals",
    version=3,
    about="The mesh's normals without the noise that the photos contradict.",
    settings=ShadingNormalSettings,
    takes=(
        "linear",
        "exposures",
        "depth",
        "normal",
        "mask",
        "cameras",
        "correspondences",
        "mesh",
        "triangles",
        "transfer",
    ),
    gives=(
        Artefact(
            "shading_normal",
            "unit normals per view that the light acts on, EXR, world axes",
            output="normal",
        ),
    ),
    run=run,
    tools=("numpy", "scipy", "numba", "llvmlite", *OPEN3D, *PICTURES),
    memory=estimated_memory,
    saves_memory=f"lower shading_normals.pixels, or {FEWER_OR_SMALLER_VIEWS}",
    found=in_words,
)
