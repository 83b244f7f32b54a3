"""Visibility of the sky from the surface, and form factors of occluding surface: ν of `mode: transfer`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from pipeline import Artefact, Job, Settings, Stage, group, setting
from stages.geometry.settings import ProxySettings
from stages.photometry.transport.settings import VisibilitySettings
from stages.scene.distributions import OPEN3D
from stages.scene.memory_of_views import BYTES_OF_LIBRARIES, PART_FOR_MESH

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy as np

    from stages.formats.meshes.triangle_meshes import Surface
    from stages.geometry.occluders import Occluders
    from stages.photometry.transport.sky_visibility import VisibilityProbes
    from stages.photometry.transport.transfer_vectors import Occlusion
    from stages.scene.cameras import Camera

BYTES_PER_THREAD = 100_000_000
BYTES_PER_VERTEX = 2_000  # at which rays begin
BYTES_PER_GIVEN_VERTEX = 800  # while the mesh is decimated, in a process of its own
BYTES_PER_VERTEX_LATER = 800  # visibility, form factors and corners, as `lighting` opens them
LEAST_VERTICES = 10_000
BYTES_OF_VERTEX_IN_FILE = 38  # of a mesh: its coordinates, and two faces
Distance = Annotated[float, Field(ge=1.5)]  # nearer, the light would be inside the scene


class TransferSettings(Settings):
    """Settings of the `transfer` stage."""

    degree: int = setting(
        4,
        "Spherical harmonics up to this degree l; diffuse surface hardly responds beyond 4.",
        ge=1,
        le=6,
    )
    directions: int = setting(
        256,
        "Rays per vertex, distributed by the cosine. The error of a half-blocked sky is about 1 over this, "
        "before neighbouring vertices are blended.",
        unit="rays",
        ge=16,
        le=16384,
    )
    sky_directions: int = setting(
        256,
        "Directions of the estimated light, all around: some 13° apart, and 5° where it is bright. Four "
        "times as many give shadows twice as sharp, and take four times as long.",
        unit="directions",
        ge=16,
        le=4096,
    )
    light_distances: tuple[Distance, ...] = setting(
        (8.0, 4.0),
        "Distances of the light that are tried beside infinity: a nearby lamp lights near surface more. The "
        "stage `lighting` chooses the distance that explains the photos best. Nearer than 1.5 the light "
        "would be inside the scene. Empty: infinity alone.",
        unit="radii of the mesh",
        max_length=8,
    )
    max_vertices: int = setting(
        200_000,
        "Larger meshes are decimated to this for the rays, since occlusion varies slowly; more views show "
        "more surface: see `usual_views`. The time is proportional to this times the rays per vertex: "
        "about a minute on two cores by default.",
        unit="vertices",
        ge=100,
    )
    usual_views: int = setting(
        40,
        "`max_vertices` holds for up to so many views. Of more, which show more surface, it grows in "
        "proportion: else a street that is three times as long has shadows three times as coarse.",
        unit="views",
        ge=1,
    )
    most_vertices: int = setting(
        5_000_000,
        "Vertices, at most, however many views there are. Later stages need about 0.8 kB for each, so it is "
        "lowered to what a fifth of the memory has room for.",
        unit="vertices",
        ge=100,
    )
    longest_edge: float = setting(
        0.02,
        "Faces are bisected while an edge is longer, unless there would be half as many vertices again as "
        "`max_vertices`: occlusion is sampled at vertices only, so a floor of two triangles would show no "
        "shadow.",
        unit="radii of the mesh",
        gt=0,
    )
    lift: float = setting(
        0.5,
        "Offset of ray origins from the surface, lest its own roughness block the sky.",
        unit="mean edges of the mesh, or of what it is decimated to; of `longest_edge` where that is less",
        gt=0,
        le=10,
    )
    proxy: ProxySettings = group(
        ProxySettings, "The decimated mesh in place of a large one, whose vertices and faces rays use."
    )
    outlier_share: float = setting(
        0.005,
        "Share of the mesh's vertices that is discarded as outliers at either end of each axis, where its "
        "middle and its radius (half the diagonal of its box) are measured.",
        ge=0,
        lt=0.5,
    )
    visibility: VisibilitySettings = group(VisibilitySettings, "Visibility of the sky from vertices.")


def run(job: Job[TransferSettings]) -> None:
    """Cast rays from the mesh's vertices to the sky. Memory: 16 B per blocked ray, and 100 MB a thread."""
    import numpy as np

    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.artefacts.transfer_file import StoredTransfer, write_transfer
    from stages.formats.meshes.triangle_meshes import read_mesh
    from stages.geometry.decimation.proxy import blend_of, roughness_of, short_edged_with_proxy
    from stages.geometry.occluders import Occluders
    from stages.geometry.rays import vertex_normals
    from stages.photometry.transport.sky_visibility import VisibilityProbes

    settings = job.settings
    mesh = read_mesh(job.inputs["mesh"])
    longest = settings.longest_edge * _middle(mesh, settings.outlier_share)[1]
    most = _most_vertices(settings, read_cameras(job.inputs["cameras"]))
    short, proxy = short_edged_with_proxy(mesh, longest, most, settings.proxy)
    normals = vertex_normals(proxy.vertices, proxy.faces)
    places = proxy.vertices + settings.lift * roughness_of(mesh, proxy, short.longest) * normals
    occluders = Occluders(proxy, job.threads)
    probes = VisibilityProbes(
        places - occluders.origin,
        normals,
        occluders.blocked,
        occluders.origin,
        settings.visibility,
        job.executor,
    )
    seen = _occlusion(probes, occluders, job)
    centre, radius = _middle(proxy, settings.outlier_share)
    radii = [np.inf, *(radius * distance for distance in settings.light_distances)]
    visible = _sky_visibility(probes, centre, radii, job)
    own_normals = vertex_normals(short.surface.vertices, short.surface.faces)
    corners, weights = blend_of(short.surface, own_normals, proxy, settings.proxy, job.threads)
    write_transfer(
        job.outputs["transfer"],
        StoredTransfer(
            blocked=seen.blocked,
            normals=normals,
            form_factors=seen.form_factors,
            behind=seen.behind,
            corners=corners,
            weights=weights,
            longest_edge=np.array(short.longest),
            vertices=proxy.vertices,
            faces=proxy.faces,
            probes=places,
            directions=np.array(settings.sky_directions),
            centre=centre,
            radii=np.array(radii),
            visible=visible,
        ),
    )
    blocked = np.asarray(seen.form_factors.sum(axis=1)) + np.asarray(seen.behind.sum(axis=1))
    job.note(vertices=len(normals), mean_blocked=round(float(blocked.mean()), 4))


def _most_vertices(settings: TransferSettings, cameras: Sequence[Camera]) -> int:
    """Bound the vertices of the proxy, by the views that show its surface, and by memory."""
    of_views = round(settings.max_vertices * max(1.0, len(cameras) / settings.usual_views))
    return min(of_views, settings.most_vertices)


def estimated_memory(settings: TransferSettings, inputs: Mapping[str, Path], threads: int) -> int:
    """Estimate the memory of decimating the mesh, or of the rays at the vertices that are left."""
    from stages.formats.artefacts.camera_file import read_cameras

    most = _most_vertices(settings, read_cameras(inputs["cameras"]))
    given = inputs["mesh"].stat().st_size // BYTES_OF_VERTEX_IN_FILE
    rays = threads * BYTES_PER_THREAD + BYTES_PER_VERTEX * min(most, given)
    return BYTES_OF_LIBRARIES + max(rays, BYTES_PER_GIVEN_VERTEX * given)


def within(settings: TransferSettings, memory: int) -> TransferSettings:
    """Take as many vertices as later stages have room for in the memory, bytes."""
    room = max(memory // PART_FOR_MESH // BYTES_PER_VERTEX_LATER, LEAST_VERTICES)
    return settings.model_copy(update={"most_vertices": min(settings.most_vertices, room)})


def _occlusion(probes: VisibilityProbes, occluders: Occluders, job: Job[TransferSettings]) -> Occlusion:
    """Compute the vertices' occlusion of the sky and their form factors."""
    from stages.photometry.transport.transfer_vectors import occlusion, points_at_once

    count, asked = len(probes.normals), (job.settings.degree, job.settings.directions)
    with job.progress("rays", -(-count // points_at_once(job.settings.directions))) as step:
        return occlusion(
            probes.positions, probes.normals, occluders.cast, count, *asked, probes.executor, step
        )


def _sky_visibility(
    probes: VisibilityProbes, centre: np.ndarray, radii: Sequence[float], job: Job[TransferSettings]
) -> np.ndarray:
    """Compute the visibility of each sphere of light from the vertices: (D, P, ⌈M/8⌉) bits."""
    import numpy as np

    from stages.photometry.transport.directional_transport import even_directions, sphere_of

    directions = even_directions(job.settings.sky_directions)
    with job.progress("directions", len(radii) * -(-len(directions) // 8)) as step:
        return np.stack([probes.see(directions, sphere_of(centre, radius), step) for radius in radii])


def _middle(surface: Surface, outlier_share: float) -> tuple[np.ndarray, float]:
    """Compute the middle and half the diagonal of the bounding box, without a share of outliers."""
    import numpy as np

    low, high = np.quantile(surface.vertices, [outlier_share, 1 - outlier_share], axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low)) / 2


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{facts['vertices']:,} vertices, from which {facts['mean_blocked']:.0%} of the sky is hidden"


TRANSFER = Stage(
    name="transfer",
    version=9,
    about="Visibility of the sky from each vertex, and form factors of what occludes it.",
    settings=TransferSettings,
    takes=("mesh", "cameras"),
    gives=(Artefact("transfer", "transfer vectors and form factors", file="transfer.npz"),),
    run=run,
    tools=("numpy", "scipy", "numba", "llvmlite", "fast-simplification", *OPEN3D),
    memory=estimated_memory,
    within=within,
    saves_memory="lower transfer.max_vertices and transfer.sky_directions",
    found=in_words,
)
