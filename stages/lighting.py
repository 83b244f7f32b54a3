"""Estimation of the illumination of all views before the albedo: light, distance, gains, specular.

Many views have their light estimated from some of them; the pixels of all are then lit cluster by cluster.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline import Artefact, Job, Stage
from stages.photometry.clusters.settings import LEAST_PIXELS
from stages.photometry.lighting.settings import LightingSettings
from stages.scene.distributions import OPEN3D, PICTURES
from stages.scene.memory_of_views import BYTES_OF_LIBRARIES, FEWER_OR_SMALLER_VIEWS

if TYPE_CHECKING:
    import numpy as np
    import scipy.sparse as sp

    from stages.formats.artefacts.transfer_file import StoredTransfer
    from stages.geometry.short_edges import ShortEdged
    from stages.photometry.clusters.view_clusters import Cluster, ViewGraph
    from stages.photometry.lighting.illumination import Illumination
    from stages.photometry.lighting.known_light import KnownLight
    from stages.photometry.lighting.opened_views import Opened
    from stages.photometry.transport.lit_scenes import LitScene
    from stages.photometry.transport.sky_visibility import VisibilityProbes
    from stages.scene.cameras import Camera


BYTES_AT_ANY_SIZE = 400_000_000  # of specular reflection and of the picture of the light
BYTES_PER_PIXEL = 400  # masked
BYTES_PER_BYTE_OF_MESH = 15  # of its file, with short edges and for casting rays
WITH_HALOS = 2  # pixels that take part in a cluster, over those that the light is found on


@dataclass(frozen=True, eq=False)
class Scene:
    """What is known of all views before their pixels are opened.

    Attributes
    ----------
    cameras : list of Camera
    graph : ViewGraph
    stored : StoredTransfer
    short : ShortEdged
        The mesh, with edges as short as those of the transfer.
    """

    cameras: list[Camera]
    graph: ViewGraph
    stored: StoredTransfer
    short: ShortEdged


@dataclass(frozen=True)
class Parts:
    """The views that one light is estimated from, and the clusters in which the pixels of all are lit."""

    some: Cluster
    clusters: list[Cluster]


def run(job: Job[LightingSettings]) -> None:
    """Estimate the light from all views, or from some, and save it, shading and data of all pixels."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.artefacts.transfer_file import read_transfer
    from stages.formats.meshes.triangle_meshes import read_mesh
    from stages.geometry.short_edges import with_short_edges
    from stages.photometry.clusters.cluster_views import view_graph

    cameras, stored = read_cameras(job.inputs["cameras"]), read_transfer(job.inputs["transfer"])
    short = with_short_edges(read_mesh(job.inputs["mesh"]), float(stored.longest_edge))
    scene = Scene(cameras, view_graph(job.inputs, cameras), stored, short)
    parts = _parts(job.settings, job.inputs, scene.graph)
    if parts is not None:
        if _from_some(job, scene, parts):
            return
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
    from stages.photometry.clusters.view_clusters import size_of

    graph = view_graph(inputs, read_cameras(inputs["cameras"]))
    parts = _parts(settings, inputs, graph)
    for_mesh = BYTES_PER_BYTE_OF_MESH * inputs["mesh"].stat().st_size
    if parts is None:
        return for_mesh + _bytes(graph.pixels.sum())
    return for_mesh + _bytes(max(size_of(one, graph)[0] for one in (parts.some, *parts.clusters)))


def _parts(how: LightingSettings, inputs: Mapping[str, Path], graph: ViewGraph) -> Parts | None:
    """Divide the views, unless they are few, or their light is known or not one."""
    from stages.photometry.clusters.view_clusters import clusters_of, typical_views

    if graph.pixels.sum() <= how.pixels or "known_light" in inputs or how.lights == "per-view":
        return None
    clusters = clusters_of(graph, WITH_HALOS * how.pixels)
    return Parts(typical_views(graph, clusters, how.pixels), clusters)


def _bytes(pixels: float) -> int:
    """Estimate the memory of so many pixels that are held at once."""
    return BYTES_OF_LIBRARIES + BYTES_AT_ANY_SIZE + int(BYTES_PER_PIXEL * pixels)


def _from_all(
    job: Job[LightingSettings],
    scene: Scene,
) -> None:
    """Estimate the light from all views at once."""
    import numpy as np

    from stages.formats.images.photos import read_environment
    from stages.photometry.clusters.view_clusters import Cluster
    from stages.photometry.lighting import lighting_record as record
    from stages.photometry.lighting.estimate_illumination import find_illumination
    from stages.photometry.lighting.illumination_by_known_light import illumination_by
    from stages.photometry.lighting.opened_views import open_views

    cameras, stored = scene.cameras, scene.stored
    every = Cluster(tuple(range(len(cameras))), ())
    known = read_environment(job.inputs["known_light"]) if "known_light" in job.inputs else None
    opened, how = open_views(job, cameras, scene.graph.side, every, None), job.settings
    record.warn_of_clipping(job, int(np.count_nonzero(~opened.unclipped)), len(opened.unclipped))
    if known is not None:
        stored = replace(stored, radii=stored.radii[:1], visible=stored.visible[:1])  # infinitely far away
    scenes = _scenes(job, opened, stored, scene.short)
    seen = opened.views.stack, opened.images
    if known is not None:
        light = _as_known(known, how, cameras, opened.scale)
        with job.progress("steps", light.turns(how.known_light) + 1 + _tries(how)) as step:
            found = illumination_by(light, *seen, scenes[0], opened.viewing, how, job.threads, step)
    else:
        with job.progress("steps", _steps(how, len(scenes))) as step:
            found = find_illumination(*seen, scenes, opened.viewing, how, job.threads, step)
    trusted = opened.viewing.trusted & found.observations.trusted
    record.note_light(job, stored, found, int(np.count_nonzero(~trusted)))
    record.report_light(job, stored, found)
    record.write_pixels(job, cameras, opened.views.own_masks, found.light.shading, found.observations)
    views = record.AllViews(
        cameras, found.light_of_view, found.gains.gains, bool(opened.viewing.trusted.any())
    )
    record.write_light_of(job, stored, found, views, opened.scale)


def _from_some(
    job: Job[LightingSettings],
    scene: Scene,
    parts: Parts,
) -> bool:
    """Estimate one light from some views and light all with it; False if they have lights of their own."""
    import numpy as np

    from stages.photometry.lighting import lighting_record as record
    from stages.photometry.lighting.estimate_illumination import find_illumination
    from stages.photometry.lighting.opened_views import gains_of_all, open_views

    cameras, stored, some = scene.cameras, scene.stored, parts.some
    opened, how = open_views(job, cameras, scene.graph.side, some, None), job.settings
    gains = gains_of_all(job, cameras, opened.scale)
    scenes, seen = _scenes(job, opened, stored, scene.short), (opened.views.stack, opened.images)
    with job.progress("steps", _steps(how, len(scenes))) as step:
        found = find_illumination(
            *seen, scenes, opened.viewing, how, job.threads, step, gains[list(some.own)]
        )
    if found.apart:
        return False
    job.note(light_found_on=[cameras[view].name for view in some.own])
    scale, clipped, untrusted, trusted = opened.scale, 0, 0, False
    typical = float(np.median(found.light.shading))
    found = found.without_pixels()
    del opened, scenes, seen
    with job.progress("clusters", len(parts.clusters)) as step:
        for cluster in parts.clusters:
            counts = _light_cluster(job, scene, cluster, found, typical, gains, scale)
            clipped, untrusted, trusted = clipped + counts[0], untrusted + counts[1], trusted or counts[2] > 0
            step()
    record.warn_of_clipping(job, clipped, int(scene.graph.pixels.sum()))
    record.note_light(job, stored, found, untrusted)
    record.report_light(job, stored, found)
    views = record.AllViews(cameras, np.zeros(len(cameras), np.int64), gains, trusted)
    record.write_light_of(job, stored, found, views, scale)
    return True


def _light_cluster(
    job: Job[LightingSettings],
    scene: Scene,
    cluster: Cluster,
    found: Illumination,
    typical: float,
    gains: np.ndarray,
    scale: float,
) -> tuple[int, int, int]:
    """Write shading and data of a cluster's own views; count their clipped, untrusted and usable pixels."""
    import numpy as np

    from stages.photometry.albedo_data import AlbedoData
    from stages.photometry.lighting.further_views import further_pixels
    from stages.photometry.lighting.lighting_record import write_pixels
    from stages.photometry.lighting.opened_views import open_views
    from stages.photometry.transport.pixel_transfer import without_opposed

    opened = open_views(job, scene.cameras, scene.graph.side, cluster, scale)
    blend, _ = without_opposed(
        opened.normals, _blend(job, opened, scene.stored, scene.short), scene.stored.normals
    )
    own_gains = gains[sorted({*cluster.own, *cluster.halo})]
    image = np.stack(opened.images, axis=1)
    shading, data = further_pixels(
        found, typical, opened.views.stack, image, opened.viewing, opened.normals, blend, own_gains
    )
    own = opened.views.own
    kept = AlbedoData(data.observed[own], data.diffuse[own], data.trusted[own], data.glossy)
    write_pixels(job, opened.views.own_cameras, opened.views.own_masks, shading[own], kept)
    usable = opened.viewing.trusted[own]
    untrusted = int(np.count_nonzero(~(usable & kept.trusted)))
    return int(np.count_nonzero(~opened.unclipped[own])), untrusted, int(np.count_nonzero(usable))


def _steps(how: LightingSettings, scenes: int) -> int:
    """Estimate the number of steps of the light estimation."""

    search = how.search
    return (
        len(search.scales) * (scenes + 1)
        + 2 * _tries(how)
        + how.specular.alternations
        + search.refined_scales
    )


def _tries(how: LightingSettings) -> int:
    """Estimate the number of reflectances that are tried."""
    return len(how.reflectance.tried) // 2 if how.reflectance_is_found else 0


def _blend(
    job: Job[LightingSettings], opened: Opened, stored: StoredTransfer, short: ShortEdged
) -> sp.csr_array:
    """Interpolate the proxy's vertices at the pixels, (N, P)."""
    from stages.formats.artefacts.view_files import read_surface_points
    from stages.geometry.vertex_interpolation import pixels_on_proxy_of

    points = read_surface_points(job.inputs, opened.views.cameras, opened.views.stack.masks)
    return pixels_on_proxy_of(short, stored, points)


def _scenes(
    job: Job[LightingSettings], opened: Opened, stored: StoredTransfer, short: ShortEdged
) -> list[LitScene]:
    """Build the scene for each distance of the light; surface points and blends are released."""
    from stages.photometry.transport.lit_scenes import scenes_by_distance
    from stages.scene.wording import tell_seen_from_behind

    blend, probes = _blend(job, opened, stored, short), _probes(job, stored)
    scenes, opposed = scenes_by_distance(stored, blend, opened.normals, probes)
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
    """Estimate the light on fewer pixels where the memory, bytes, has no room for as many."""
    pixels = max(
        (memory - BYTES_OF_LIBRARIES - BYTES_AT_ANY_SIZE) // (WITH_HALOS * BYTES_PER_PIXEL), LEAST_PIXELS
    )
    return settings.model_copy(update={"pixels": min(settings.pixels, pixels)})


LIGHTING = Stage(
    name="lighting",
    version=9,
    about="The light of all views, its distance, view gains and specular reflection.",
    settings=LightingSettings,
    takes=("linear", "normal", "mask", "cameras", "correspondences", "mesh", "triangles", "transfer"),
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
        Artefact("observations", "per view: radiance with and without gloss, and trusted pixels, npz"),
    ),
    run=run,
    tools=("numpy", "scipy", "numba", "llvmlite", *OPEN3D, *PICTURES),
    memory=estimated_memory,
    within=within,
    saves_memory=f"lower lighting.pixels, or {FEWER_OR_SMALLER_VIEWS}",
)
