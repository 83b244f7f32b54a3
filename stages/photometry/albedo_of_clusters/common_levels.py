"""Coarse levels of all clusters together: each adds up its pixels, they are solved once, and all begin there.

What reaches far, whole walls of one paint, is then the same on both sides of a border between clusters: a
cluster has to find only what is finer, and ends where the coarse levels say.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stages.photometry.albedo.albedo_given_light import KINDS
from stages.photometry.albedo.smooth_albedo import level_under_light
from stages.photometry.albedo_of_clusters.opened_cluster import ClusterTask, OpenedCluster, opened, weights_of
from stages.photometry.clusters.surface_clusters import Cluster
from stages.photometry.joint.begun_level import BegunLevel
from stages.photometry.joint.coarse_to_fine import coarse_solution, steps_of
from stages.photometry.joint.joined_level import PartOfLevel, joined
from stages.photometry.joint.problem_assembly import ALIKE, EdgeWeights
from stages.photometry.stack import ALIGNED
from stages.solvers.kernels.arrays_in_files import load_mapped
from stages.solvers.primal_dual.state_files import load_state, save_state

EDGES = ("smoothness", "agreement")  # of `EdgeWeights`
PLACES = "places.npy"


def add_up_cluster(cluster: Cluster, task: ClusterTask, threads: int) -> None:
    """Keep the weights of a cluster's edges, and what its pixels add to coarse levels. Picklable."""
    found = opened(cluster, task, threads)
    by_edge = weights_of(found, task).in_file(task.parts.folder)
    for name in EDGES:
        np.save(_edges_file(task, cluster, name), getattr(by_edge, name))
    for kind, edges in zip(KINDS, (ALIKE, by_edge), strict=True):
        _part_of(found, edges, task).save(_part_file(task, cluster, kind))


def _part_of(found: OpenedCluster, edges: EdgeWeights, task: ClusterTask) -> PartOfLevel:
    """Add up what a cluster's own pixels contribute to a coarse level."""
    views, data = found.views, found.observed
    given = views.stack, data.diffuse, found.shading, data.trusted, task.solver, edges
    level = level_under_light(*given, views.own)
    return PartOfLevel.of(level, depth_of(task), views.numbers, views.origins)


def solve_coarse_levels(kind: str, task: ClusterTask, threads: int) -> None:
    """Solve the coarse levels that the pixels of all clusters add up to, of a kind of albedo. Picklable."""
    parts = [PartOfLevel.load(_part_file(task, cluster, kind)) for cluster in task.parts.clusters]
    level, places = joined(parts, len(task.cameras))
    del parts
    folder, light = _state_folder(task, kind), np.ones((len(task.cameras), 3, 1))
    folder.mkdir(exist_ok=True)  # a lost worker's task is done again
    np.save(folder / PLACES, places)
    state = coarse_solution(level, depth_of(task), task.solver.how, threads, light, task.parts.folder)
    save_state(folder, state)


def kept_weights(task: ClusterTask, cluster: Cluster) -> EdgeWeights:
    """Map the weights of a cluster's edges that `add_up_cluster` kept."""
    return EdgeWeights(*(load_mapped(_edges_file(task, cluster, name)) for name in EDGES))


def begun_levels(task: ClusterTask, found: OpenedCluster) -> dict[str, BegunLevel]:
    """Map the coarse levels of all clusters, of each kind of albedo, for one to begin from."""
    views, steps = found.views, steps_of(task.solver.how, known_light=True)
    return {
        kind: BegunLevel(
            depth_of(task),
            load_mapped(_state_folder(task, kind) / PLACES),
            load_state(_state_folder(task, kind), steps, free_light=False),
            views.numbers,
            views.origins,
            views.rim,
        )
        for kind in KINDS
    }


def depth_of(task: ClusterTask) -> int:
    """Find how many levels above the finest that one is which is solved for all clusters together."""
    how, pixels, depth = task.settings.clusters, int(task.graph.pixels.sum()), 1
    while pixels > how.coarse_share * how.pixels * 4**depth and 2**depth < ALIGNED:
        depth += 1
    return depth


def _edges_file(task: ClusterTask, cluster: Cluster, name: str) -> Path:
    return task.file(cluster, f"{name}.npy")


def _part_file(task: ClusterTask, cluster: Cluster, kind: str) -> Path:
    return task.file(cluster, f"{kind}.npz")


def _state_folder(task: ClusterTask, kind: str) -> Path:
    return task.parts.folder / f"coarse_{kind}"
