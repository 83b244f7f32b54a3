"""The albedo of clusters of the surface: smooth, then with its detail; each is kept in files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stages.photometry.albedo.albedo_given_light import (
    NOTHING_BEGUN,
    SmoothAlbedos,
    smooth_albedos_under_light,
)
from stages.photometry.albedo.clipped_pixels import raised_where_clipped
from stages.photometry.albedo.confidence import confidence_of
from stages.photometry.albedo_of_clusters.common_levels import begun_levels, kept_weights
from stages.photometry.albedo_of_clusters.opened_cluster import ClusterTask, OpenedCluster, opened, weights_of
from stages.photometry.clusters.surface_clusters import Cluster
from stages.photometry.decomposition_record import Solution, below_zero
from stages.photometry.detail.albedo_detail import Detail, sampled_detail, with_detail
from stages.photometry.detail.detail_scene import DetailScene
from stages.photometry.detail.scene_statistics import DetailStatistics, SampledDetail
from stages.photometry.energy_history import rounds_under_light_as_json
from stages.photometry.joint.begun_level import BegunLevel
from stages.photometry.joint.problem_assembly import EdgeWeights
from stages.photometry.paper.alternation import worse
from stages.solvers.kernels.threading_layer import use_threads


def solve_whole(
    cluster: Cluster, task: ClusterTask, threads: int, step: Callable[[], None]
) -> tuple[Solution, DetailStatistics]:
    """Solve the only cluster, keep its maps, and report; with the statistics of its detail."""
    found = opened(cluster, task, threads)
    by_edge = weights_of(found, task).in_file(task.parts.folder)
    smooth = _smooth(task, found, cluster, by_edge, NOTHING_BEGUN, step)
    detail = with_detail(_detail_scene(task, found, smooth.by_edge.albedo))
    return _kept(task, found, cluster, detail, _draft(found, smooth)), detail.statistics


def begin_cluster(cluster: Cluster, task: ClusterTask, threads: int) -> tuple[Solution, SampledDetail]:
    """Solve a cluster for its smooth albedo, which is kept, and sample its detail. Picklable."""
    found = opened(cluster, task, threads)
    smooth = _smooth(
        task, found, cluster, kept_weights(task, cluster), begun_levels(task, found), lambda: None
    )
    np.save(_smooth_file(task, cluster), smooth.by_edge.albedo)
    return _draft(found, smooth), sampled_detail(_detail_scene(task, found, smooth.by_edge.albedo))


def finish_cluster(
    begun: tuple[Cluster, Solution], common: DetailStatistics, task: ClusterTask, threads: int
) -> Solution:
    """Add the detail to a cluster's smooth albedo, by statistics of all; keep its maps. Picklable."""
    cluster, draft = begun
    found = opened(cluster, task, threads)
    albedo = np.load(_smooth_file(task, cluster), allow_pickle=False)
    detail = with_detail(_detail_scene(task, found, albedo), common)
    return _kept(task, found, cluster, detail, draft)


def _smooth_file(task: ClusterTask, cluster: Cluster) -> Path:
    return task.file(cluster, "smooth_albedo_with_margin.npy")


def _smooth(
    task: ClusterTask,
    found: OpenedCluster,
    cluster: Cluster,
    by_edge: EdgeWeights,
    begun: Mapping[str, BegunLevel],
    step: Callable[[], None],
) -> SmoothAlbedos:
    """Estimate the smooth albedos, and keep that of Eq. 2."""
    given = found.views.stack, found.shading, found.observed, by_edge, task.solver, found.threads
    smooth = smooth_albedos_under_light(*given, step, task.parts.folder, begun)
    of_energy = np.maximum(smooth.alike.albedo, 0) * _unit(found)
    task.parts.keep(cluster, found.views, {"albedo_tv": of_energy})
    return smooth


def _detail_scene(task: ClusterTask, found: OpenedCluster, albedo: np.ndarray) -> DetailScene:
    """Put together what the detail of a smooth albedo is found from."""
    use_threads(found.threads)  # the solver may have left fewer
    observed, views = found.observed, found.views
    return DetailScene.of(
        views.stack,
        albedo,
        observed.diffuse,
        found.shading,
        observed.trusted,
        task.settings.detail,
        found.part,
        task.parts.folder,
        found.light.around.gains[list(views.numbers)].mean(axis=1).astype(np.float32),
    )


def _draft(found: OpenedCluster, smooth: SmoothAlbedos) -> Solution:
    """Report the smooth albedo of a cluster."""
    views, outcome = found.views, worse(smooth.alike.outcome, smooth.by_edge.outcome)
    return Solution(
        views=[camera.name for camera, own in zip(views.cameras, views.own_counts, strict=True) if own],
        pixels=int(views.own.sum()),
        pixels_with_margin=len(views.own),
        links=views.stack.correspondence_count,
        negative_shading=below_zero(found.shading[views.own]),
        negative_albedo={},
        histories=rounds_under_light_as_json(smooth.alike, outcome),
        outcomes=[outcome] * 3,
    )


def _kept(
    task: ClusterTask, found: OpenedCluster, cluster: Cluster, detail: Detail, draft: Solution
) -> Solution:
    """Keep the albedo and its confidence, and complete the report."""
    trusted = found.observed.trusted & found.light.trusted  # if none is, all are used: a guess
    least = found.part.typical.least_light(task.settings.detail.least_light)
    seen = found.observed.diffuse, found.shading, least, found.observed.clipped
    albedo = raised_where_clipped(found.views.stack, detail.albedo, *seen, task.settings.clipped)
    albedo *= _unit(found)
    confidence = confidence_of(detail.variance, trusted, task.settings.confidence)
    task.parts.keep(cluster, found.views, {"albedo": albedo, "confidence": confidence})
    negative = below_zero(albedo[found.views.own])
    return replace(draft, negative_albedo=negative)


def _unit(found: OpenedCluster) -> Any:
    """Compute the images' unit over that of the shading, per channel, (3,), float32."""
    return np.float32(found.light.image_scale) / found.light.mean_shading.astype(np.float32)
