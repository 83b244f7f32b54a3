"""Estimation of the illumination of all views before the albedo: light, distance, gains, specular.

Many views have their light estimated from some of them; the pixels of all are then lit in clusters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Stage, counted
from stages.photometry.clusters.settings import LEAST_PIXELS
from stages.photometry.lighting.settings import LightingSettings
from stages.scene.distributions import OPEN3D, PICTURES
from stages.scene.memory_of_views import (
    BYTES_OF_LIBRARIES,
    FEWER_OR_SMALLER_VIEWS,
    PART_FOR_MESH,
    left_for_pixels,
)

if TYPE_CHECKING:
    import numpy as np
    import scipy.sparse as sp

    from stages.formats.artefacts.transfer_file import StoredTransfer
    from stages.formats.artefacts.view_files import Each
    from stages.geometry.short_edges import ShortEdged
    from stages.photometry.clusters.typical_views import ViewGraph
    from stages.photometry.further_views.seen_vertices import SurfaceViews
    from stages.photometry.lighting.illumination import Illumination
    from stages.photometry.lighting.known_light import KnownLight
    from stages.photometry.lighting.opened_views import Opened, ViewFiles
    from stages.photometry.sun.pixel_rays import PixelRays
    from stages.photometry.sun.settings import SunSettings
    from stages.photometry.transport.lit_scenes import LitScene
    from stages.photometry.transport.shown_radiance import ShownRadiance
    from stages.photometry.transport.sky_visibility import VisibilityProbes
    from stages.photometry.transport.transfer_vectors import Proxy
    from stages.scene.cameras import Camera


BYTES_AT_ANY_SIZE = 400_000_000  # of specular reflection and of the picture of the light
BYTES_PER_PIXEL = 340  # masked, with a sun and its shadows; 260 without
BYTES_PER_BYTE_OF_MESH = 15  # of its file, with short edges and for casting rays


@dataclass(frozen=True, eq=False)
class Scene:
    """What is known of all views before their pixels are opened. Picklable.

    Attributes
    ----------
    cameras : list of Camera
    files : ViewFiles
    graph : ViewGraph
    stored : StoredTransfer
    short : ShortEdged
        The mesh, with edges as short as those of the transfer.
    sun : SunSettings
    """

    cameras: list[Camera]
    files: ViewFiles
    graph: ViewGraph
    stored: StoredTransfer
    short: ShortEdged
    sun: SunSettings

    def blend(self, cameras: Sequence[Camera], masks: Sequence[np.ndarray], each: Each = map) -> sp.csr_array:
        """Interpolate the proxy's vertices at the masked pixels of cameras, (N, P)."""
        from stages.formats.artefacts.view_files import read_surface_points
        from stages.geometry.vertex_interpolation import pixels_on_proxy_of

        points = read_surface_points(self.files.paths, cameras, masks)
        return pixels_on_proxy_of(self.short, self.stored, points, each)

    def rays(self, cameras: Sequence[Camera], masks: Sequence[np.ndarray], threads: int) -> PixelRays:
        """Make rays from the masked pixels of cameras to suns, which the mesh may block."""
        import numpy as np

        from stages.formats.artefacts.view_files import read_surface_points
        from stages.formats.meshes.triangle_meshes import read_mesh
        from stages.geometry.smooth_surface import SmoothSurface
        from stages.photometry.sun.pixel_rays import PixelRays

        def prepared() -> SmoothSurface:
            return SmoothSurface(read_mesh(self.files.paths["mesh"]), threads)

        def points_of(view: int) -> tuple[np.ndarray, np.ndarray]:
            faces, barycentric = read_surface_points(self.files.paths, [cameras[view]], [masks[view]])
            return faces[0], barycentric[0]

        starts = np.cumsum([0, *(np.count_nonzero(mask) for mask in masks)])
        return PixelRays(prepared, points_of, starts, self.sun)


def run(job: Job[LightingSettings]) -> None:
    """Estimate the light from all views, or from some, and save it, shading and data of all pixels."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.artefacts.transfer_file import read_transfer
    from stages.formats.meshes.triangle_meshes import read_mesh
    from stages.geometry.short_edges import with_short_edges
    from stages.photometry.clusters.cluster_views import view_graph
    from stages.photometry.lighting.opened_views import ViewFiles

    cameras, stored = read_cameras(job.inputs["cameras"]), read_transfer(job.inputs["transfer"])
    short = with_short_edges(read_mesh(job.inputs["mesh"]), float(stored.longest_edge))
    graph = view_graph(job.inputs, cameras)
    files = ViewFiles(dict(job.inputs), cameras, graph.side, job.settings.trusted_pixels)
    scene = Scene(cameras, files, graph, stored, short, job.settings.sun)
    if _has_room(job.settings, job.inputs, graph):
        _from_all(job, scene)
    elif not _from_some(job, scene):
        job.warn(
            "Views differ by more than one light explains: their lights are estimated from all at once, "
            "with memory for all. Where that is too much, choose fewer views (raycast.views), or set "
            "lighting.lights=shared."
        )
        _from_all(job, scene)


def estimated_memory(settings: LightingSettings, inputs: Mapping[str, Path], threads: int) -> int:
    """Estimate the memory from masked pixels; measured values are up to a third off it."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.photometry.clusters.cluster_views import view_graph
    from stages.photometry.clusters.settings import expected_size

    graph = view_graph(inputs, read_cameras(inputs["cameras"]))
    pixels = int(graph.pixels.sum())
    if not _has_room(settings, inputs, graph):
        pixels = max(settings.pixels, expected_size(pixels, settings.clusters))
    mesh = BYTES_PER_BYTE_OF_MESH * inputs["mesh"].stat().st_size
    return BYTES_OF_LIBRARIES + BYTES_AT_ANY_SIZE + mesh + BYTES_PER_PIXEL * pixels


def _has_room(how: LightingSettings, inputs: Mapping[str, Path], graph: ViewGraph) -> bool:
    """Whether all views are opened at once: they are few, or their light is known or not one."""
    return graph.pixels.sum() <= how.pixels or "known_light" in inputs or how.lights == "per-view"


def _from_all(job: Job[LightingSettings], scene: Scene) -> None:
    """Estimate the light from all views at once."""
    import numpy as np

    from stages.formats.images.photos import read_environment
    from stages.photometry.clusters.surface_clusters import Cluster
    from stages.photometry.lighting import lighting_record as record
    from stages.photometry.lighting.estimate_illumination import find_illumination
    from stages.photometry.lighting.illumination_by_known_light import illumination_by
    from stages.photometry.lighting.opened_views import exposures_of

    cameras = scene.cameras
    known = read_environment(job.inputs["known_light"]) if "known_light" in job.inputs else None
    every = Cluster.whole(range(len(cameras)), scene.graph.pixels.sum())
    opened = scene.files.open(every, None, job.executor.map)
    how = job.settings
    record.warn_of_clipping(job, int(np.count_nonzero(~opened.unclipped)), len(opened.unclipped))
    if known is not None:
        far = replace(scene.stored, radii=scene.stored.radii[:1], visible=scene.stored.visible[:1])
        scene = replace(scene, stored=far)  # infinitely far away
    scenes = _scenes(job, opened, scene)
    seen, exposures = (opened.views.stack, opened.images), exposures_of(job.inputs, cameras)
    if known is not None:
        light = _as_known(known, how, cameras, opened.scale)
        with job.progress("steps", light.turns(how.known_light) + 1 + _tries(how)) as step:
            found = illumination_by(
                light, *seen, scenes[0], opened.viewing, how, job.threads, step, exposures
            )
    else:
        with job.progress("steps", _steps(how, len(scenes))) as step:
            rays = scene.rays(cameras, opened.views.masks, job.threads)
            found = find_illumination(
                *seen, scenes, opened.viewing, how, job.threads, step, None, exposures, rays
            )
    trusted = opened.viewing.trusted & found.observations.trusted
    shadowed = found.explained.shadowed
    dark = 0 if shadowed is None else int(np.count_nonzero(shadowed))
    record.note_light(job, scene.stored, found, int(np.count_nonzero(~trusted)), dark)
    record.report_light(job, scene.stored, found)
    record.write_pixels(job, cameras, opened.views.masks, found.light.shading, found.observations)
    views = record.AllViews(
        cameras, found.light_of_view, found.gains.gains, bool(opened.viewing.trusted.any())
    )
    record.write_light_of(job, scene.stored, found, views, opened.scale)


def _from_some(job: Job[LightingSettings], scene: Scene) -> bool:
    """Estimate one light from some views and light all with it; False if they have lights of their own."""
    import numpy as np

    from stages.photometry.clusters.surface_clusters import Cluster
    from stages.photometry.clusters.typical_views import typical_views
    from stages.photometry.further_views.seen_vertices import SurfaceViews
    from stages.photometry.lighting import lighting_record as record
    from stages.photometry.lighting.estimate_illumination import find_illumination
    from stages.photometry.lighting.opened_views import gains_of_all

    cameras, how = scene.cameras, job.settings
    some = typical_views(scene.graph, how.pixels)
    opened = scene.files.open(
        Cluster.whole(some, scene.graph.pixels[list(some)].sum()), None, job.executor.map
    )
    gains = gains_of_all(job, scene.files, opened.scale, how.gains)
    every = SurfaceViews(scene.files, scene.blend, scene.stored.normals, gains, opened.scale)
    scenes, seen = _scenes(job, opened, scene), (opened.views.stack, opened.images)
    if how.bounces:  # these views do not show all surface, and so hardly tell what it reflects
        shown = _radiance_shown(job, every, scenes[0].proxy)
        scenes = [replace(one, shown=shown) for one in scenes]
    with job.progress("steps", _steps(how.to_begin_with(), len(scenes))) as step:  # no reflectance is tried
        rays = scene.rays(opened.views.cameras, opened.views.masks, job.threads)
        found = find_illumination(
            *seen, scenes, opened.viewing, how, job.threads, step, gains[list(some)], None, rays
        )
    if found.apart:
        return False
    job.note(light_found_on=[cameras[view].name for view in some])
    found = found.without_pixels()
    del opened, scenes, seen, rays
    clipped, untrusted, usable, shadowed = _light_all(job, scene, found, every)
    record.warn_of_clipping(job, clipped, int(scene.graph.pixels.sum()))
    record.note_light(job, scene.stored, found, untrusted, shadowed)
    record.report_light(job, scene.stored, found)
    views = record.AllViews(cameras, np.zeros(len(cameras), np.int64), gains, usable > 0)
    record.write_light_of(job, scene.stored, found, views, every.scale)
    return True


def _radiance_shown(job: Job[LightingSettings], views: SurfaceViews, proxy: Proxy) -> ShownRadiance:
    """Average the radiance of the vertices that the photos of all views show."""
    from stages.photometry.further_views.seen_vertices import seen_vertices, shown_by_all

    every = range(len(views.gains))
    with job.progress("bounces", len(every)) as step:
        return shown_by_all(proxy, counted(job.tasks.small(seen_vertices, every, views), step))


def _light_all(
    job: Job[LightingSettings], scene: Scene, found: Illumination, views: SurfaceViews
) -> tuple[int, int, int, int]:
    """Light the pixels of all views, in clusters; count the clipped, untrusted, usable and shadowed ones."""
    from stages.photometry.clusters.cluster_views import divided_surface
    from stages.photometry.clusters.parts import Parts
    from stages.photometry.clusters.surface_clusters import tell_too_large
    from stages.photometry.further_views.lit_clusters import LightTask, light_cluster
    from stages.photometry.lighting.lighting_record import write_view

    clusters = divided_surface(
        job.inputs, scene.cameras, scene.graph, job.settings.clusters, job.executor.map
    )
    tell_too_large(job, clusters, job.settings.clusters)
    parts = Parts(job.scratch, scene.files.paths, scene.cameras, clusters)
    task = LightTask(views, scene.rays, parts, found)
    with job.progress("clusters", len(clusters)) as step:
        counts = list(counted(job.tasks.large(light_cluster, clusters, task), step))
    folders = job.outputs["shading"], job.outputs["observations"]
    with job.progress("views", len(scene.cameras)) as step:
        for _ in job.tasks.small(write_view, range(len(scene.cameras)), parts, *folders):
            step()
    clipped, untrusted, usable, shadowed = (sum(column) for column in zip(*counts, strict=True))
    return clipped, untrusted, usable, shadowed


def _steps(how: LightingSettings, scenes: int) -> int:
    """Estimate the number of steps of the light estimation."""

    search = how.search
    return (
        len(search.scales) * (scenes + 1)
        + 2  # suns, and shadows of what the mesh does not have
        + 2 * _tries(how)
        + how.specular.alternations
        + search.refined_scales
    )


def _tries(how: LightingSettings) -> int:
    """Estimate the number of reflectances that are tried."""
    return len(how.reflectance.tried) // 2 if how.reflectance_is_found else 0


def _scenes(job: Job[LightingSettings], opened: Opened, scene: Scene) -> list[LitScene]:
    """Build the scene for each distance of the light; surface points and blends are released."""
    from stages.photometry.transport.lit_scenes import scenes_by_distance
    from stages.scene.wording import tell_seen_from_behind

    blend = scene.blend(opened.views.cameras, opened.views.masks, job.executor.map)
    probes = _probes(job, scene.stored)
    scenes, opposed = scenes_by_distance(scene.stored, blend, opened.normals, probes)
    tell_seen_from_behind(job, opposed, len(opened.normals))
    return scenes


def _as_known(
    picture: np.ndarray, settings: LightingSettings, cameras: list[Camera], image_scale: float
) -> KnownLight:
    """Convert an environment map to a known light in the scale of the photos."""
    from stages.photometry.lighting.known_light import KnownLight
    from stages.scene.upright import upright_from_world

    scale = 1 / image_scale if settings.known_scale == "fixed" else None
    upright = upright_from_world(cameras, settings.upright_within_deg)
    return KnownLight.of(picture, upright, settings.known_turn_deg, scale, settings.environment_map)


def _probes(job: Job[LightingSettings], stored: StoredTransfer) -> VisibilityProbes:
    """Build visibility probes at the proxy's vertices, with the proxy as occluder."""
    from stages.formats.meshes.triangle_meshes import Surface
    from stages.geometry.occluders import Occluders
    from stages.photometry.transport.sky_visibility import VisibilityProbes

    proxy = Occluders(Surface(stored.vertices, stored.faces), job.threads)
    return VisibilityProbes(
        stored.probes - proxy.origin,
        stored.normals,
        proxy.blocked,
        proxy.origin,
        job.settings.visibility,
        job.executor,
    )


def within(settings: LightingSettings, memory: int) -> LightingSettings:
    """Estimate the light on fewer pixels, in smaller clusters, as the memory, bytes, has room for."""
    for_pixels = left_for_pixels(memory - memory // PART_FOR_MESH - BYTES_AT_ANY_SIZE)
    room = max(for_pixels // BYTES_PER_PIXEL, LEAST_PIXELS)
    clusters = settings.clusters.within(room)
    return settings.model_copy(update={"pixels": min(settings.pixels, room), "clusters": clusters})


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    gloss = "specular reflection" if facts["specular"] else "no specular reflection"
    suns = len(facts["suns"])
    small = ", 1 sun" if suns == 1 else f", {suns} suns" if suns else ""
    if facts["shadowed_pixels"]:
        small += f" ({facts['shadowed_pixels']:,} pixels in the shadow of what the mesh does not have)"
    return f"light from {facts['directions'] - suns} directions{small}, {gloss}"


LIGHTING = Stage(
    name="lighting",
    version=24,
    about="The light of all views, its distance, view gains and specular reflection.",
    settings=LightingSettings,
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
    may_take=("known_light",),
    gives=(
        Artefact("lighting", "light per view and channel", file="lighting.json", output="lighting.json"),
        Artefact("light_pictures", "the light from all directions, EXR and PNG", output="environment"),
        Artefact(
            "shading",
            "shading per view, EXR, linear: image = albedo × shading, except gloss",
            output="shading",
        ),
        Artefact("found_light", "the light, gains and gloss, npz", file="light.npz"),
        Artefact(
            "observations", "per view: radiance with and without gloss, trusted and clipped pixels, npz"
        ),
    ),
    run=run,
    tools=("numpy", "scipy", "numba", "llvmlite", *OPEN3D, *PICTURES),
    memory=estimated_memory,
    within=within,
    saves_memory=f"lower lighting.pixels, or {FEWER_OR_SMALLER_VIEWS}",
    found=in_words,
)
