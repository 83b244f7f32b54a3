"""The albedo of clusters of the surface: smooth, then with its detail; each is kept in files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.process.free_memory import give_back_garbage
from stages.formats.artefacts.light_npz import StoredLight, read_light
from stages.photometry.albedo.albedo_given_light import SmoothAlbedos, smooth_albedos_under_light
from stages.photometry.albedo.clipped_pixels import raised_where_clipped
from stages.photometry.albedo.confidence import confidence_of
from stages.photometry.albedo_data import BY_PIXEL, AlbedoData
from stages.photometry.clusters.cluster_views import ClusterViews, open_cluster
from stages.photometry.clusters.parts import Parts
from stages.photometry.clusters.surface_clusters import Cluster
from stages.photometry.clusters.typical_views import ViewGraph
from stages.photometry.decomposition_record import Solution, below_zero
from stages.photometry.decomposition_settings import DecompositionSettings
from stages.photometry.detail.albedo_detail import Detail, with_detail
from stages.photometry.detail.part_of_scene import PartOfScene, TypicalPixel, whole_scene
from stages.photometry.detail.scene_statistics import DetailStatistics, SampledDetail
from stages.photometry.energy_history import rounds_under_light_as_json
from stages.photometry.joint.fast_alternation import FastSolver
from stages.photometry.paper.alternation import worse
from stages.scene.cameras import Camera
from stages.solvers.kernels.arrays_in_files import in_file
from stages.solvers.kernels.pixelwise import on_threads
from stages.solvers.kernels.threading_layer import use_threads


@dataclass(frozen=True)
class ClusterTask:
    """All that clusters are solved from. Picklable.

    Attributes
    ----------
    inputs : mapping of str to Path
        Artefacts as of the stage.
    parts : Parts
        Where maps of the pixels are kept, until they are put together view by view.
    cameras : list of Camera
        Of all views.
    graph : ViewGraph
        Of all views.
    typical : TypicalPixel or None
        Of all views; None: of the cluster, which has all.
    solver : FastSolver
    settings : DecompositionSettings
    """

    inputs: Mapping[str, Path]
    parts: Parts
    cameras: list[Camera]
    graph: ViewGraph
    typical: TypicalPixel | None
    solver: FastSolver
    settings: DecompositionSettings


@dataclass(frozen=True, eq=False)
class OpenedCluster:
    """Data of the pixels that take part in a cluster, (N, …), and the threads to use for them."""

    views: ClusterViews
    light: StoredLight
    shading: np.ndarray
    observed: AlbedoData
    part: PartOfScene
    threads: int


def solve_whole(
    cluster: Cluster, task: ClusterTask, threads: int, step: Callable[[], None]
) -> tuple[Solution, SampledDetail]:
    """Solve the only cluster, keep its maps, and report; with what was sampled for statistics."""
    opened = _opened(cluster, task, threads)
    smooth = _smooth(task, opened, cluster, step)
    detail = _with_detail(task, opened, smooth.by_edge.albedo, None)
    return _kept(task, opened, cluster, detail, _draft(opened, smooth)), detail.sample


def begin_cluster(cluster: Cluster, task: ClusterTask, threads: int) -> tuple[Solution, SampledDetail]:
    """Solve a cluster for its smooth albedo, which is kept, and sample its detail. Picklable."""
    opened = _opened(cluster, task, threads)
    smooth = _smooth(task, opened, cluster, lambda: None)
    np.save(_smooth_file(task, cluster), smooth.by_edge.albedo)
    return _draft(opened, smooth), _with_detail(task, opened, smooth.by_edge.albedo, None).sample


def finish_cluster(
    begun: tuple[Cluster, Solution], common: DetailStatistics, task: ClusterTask, threads: int
) -> Solution:
    """Add the detail to a cluster's smooth albedo, by statistics of all; keep its maps. Picklable."""
    cluster, draft = begun
    opened = _opened(cluster, task, threads)
    albedo = np.load(_smooth_file(task, cluster), allow_pickle=False)
    return _kept(task, opened, cluster, _with_detail(task, opened, albedo, common), draft)


def _smooth_file(task: ClusterTask, cluster: Cluster) -> Path:
    return task.parts.folder / f"{cluster.number}_smooth_albedo_with_margin.npy"


def _opened(cluster: Cluster, task: ClusterTask, threads: int) -> OpenedCluster:
    """Open masks, correspondences, shading and observations of a cluster, all in files.

    Solving and detail each use some of it for a while, and the solver needs the memory.
    """
    use_threads(threads)
    folder = task.parts.folder
    give_back_garbage()  # of the cluster before: the solver's arrays are elsewhere
    light = read_light(task.inputs["found_light"])
    views = open_cluster(task.inputs, task.cameras, cluster, task.graph.side, on_threads)
    views = replace(views, stack=views.stack.in_file(folder))
    shading = views.maps(task.inputs["shading"], on_threads) / light.mean_shading.astype(np.float32)
    kept = views.arrays(task.inputs["observations"], BY_PIXEL, on_threads)
    shading, *observations = in_file([shading, *kept.values()], folder)
    observed = AlbedoData(**dict(zip(kept, observations, strict=True)), glossy=light.glossy)
    del kept
    return OpenedCluster(views, light, shading, observed, _part(views, shading, observed, task), threads)


def _part(views: ClusterViews, shading: np.ndarray, observed: AlbedoData, task: ClusterTask) -> PartOfScene:
    """Tell which pixels of all these are, and what is typical of all."""
    how = task.settings.detail
    if task.typical is None:
        return whole_scene(shading, observed.diffuse, how.log_offset, how.sample_pixels)
    pixels = int(task.graph.pixels.sum())
    return PartOfScene(views.places(task.graph), views.own, pixels, task.typical)


def _smooth(
    task: ClusterTask, opened: OpenedCluster, cluster: Cluster, step: Callable[[], None]
) -> SmoothAlbedos:
    """Estimate the smooth albedos, and keep that of Eq. 2."""
    smooth = smooth_albedos_under_light(
        opened.views.stack,
        opened.shading,
        opened.observed,
        task.settings.edges,
        task.solver,
        opened.part.typical.light,
        opened.threads,
        step,
        task.parts.folder,
    )
    of_energy = np.maximum(smooth.alike.albedo, 0) * _unit(opened)
    task.parts.keep(cluster, opened.views, {"albedo_tv": of_energy})
    return smooth


def _with_detail(
    task: ClusterTask, opened: OpenedCluster, albedo: np.ndarray, common: DetailStatistics | None
) -> Detail:
    """Add the detail to a smooth albedo, by common statistics, or by its own."""
    use_threads(opened.threads)  # the solver may have left fewer
    observed, views = opened.observed, opened.views
    return with_detail(
        views.stack,
        albedo,
        observed.diffuse,
        opened.shading,
        observed.trusted,
        task.settings.detail,
        opened.part,
        common,
        task.parts.folder,
        opened.light.around.gains[list(views.numbers)].mean(axis=1).astype(np.float32),
    )


def _draft(opened: OpenedCluster, smooth: SmoothAlbedos) -> Solution:
    """Report the smooth albedo of a cluster."""
    views, outcome = opened.views, worse(smooth.alike.outcome, smooth.by_edge.outcome)
    return Solution(
        views=[camera.name for camera, own in zip(views.cameras, views.own_counts, strict=True) if own],
        pixels=int(views.own.sum()),
        pixels_with_margin=len(views.own),
        links=views.stack.correspondence_count,
        negative_shading=below_zero(opened.shading[views.own]),
        negative_albedo={},
        histories=rounds_under_light_as_json(smooth.alike, outcome),
        outcomes=[outcome] * 3,
    )


def _kept(
    task: ClusterTask, opened: OpenedCluster, cluster: Cluster, detail: Detail, draft: Solution
) -> Solution:
    """Keep the albedo and its confidence, and complete the report."""
    trusted = opened.observed.trusted & opened.light.trusted  # if none is, all are used: a guess
    least = opened.part.typical.least_light(task.settings.detail.least_light)
    seen = opened.observed.diffuse, opened.shading, least, opened.observed.clipped
    albedo = raised_where_clipped(opened.views.stack, detail.albedo, *seen, task.settings.clipped)
    albedo *= _unit(opened)
    confidence = confidence_of(detail.variance, trusted, task.settings.confidence)
    task.parts.keep(cluster, opened.views, {"albedo": albedo, "confidence": confidence})
    negative = below_zero(albedo[opened.views.own])
    return replace(draft, negative_albedo=negative)


def _unit(opened: OpenedCluster) -> Any:
    """Compute the images' unit over that of the shading, per channel, (3,), float32."""
    return np.float32(opened.light.image_scale) / opened.light.mean_shading.astype(np.float32)
