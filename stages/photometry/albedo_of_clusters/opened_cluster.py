"""All that the albedo of a cluster is found from, and its pixels, opened."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.process.free_memory import give_back_garbage
from stages.formats.artefacts.light_npz import StoredLight, read_light
from stages.photometry.albedo.albedo_given_light import weights_of_edges
from stages.photometry.albedo_data import BY_PIXEL, AlbedoData
from stages.photometry.clusters.cluster_views import ClusterViews, open_cluster
from stages.photometry.clusters.parts import Parts
from stages.photometry.clusters.surface_clusters import Cluster
from stages.photometry.clusters.typical_views import ViewGraph
from stages.photometry.decomposition_settings import DecompositionSettings
from stages.photometry.detail.detail_scene import PartOfScene, TypicalPixel, whole_scene
from stages.photometry.joint.fast_alternation import FastSolver
from stages.photometry.joint.problem_assembly import EdgeWeights
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

    def file(self, cluster: Cluster, name: str) -> Path:
        """Name a file that is kept of a cluster until the stage is done."""
        return self.parts.folder / f"{cluster.number}_{name}"


@dataclass(frozen=True, eq=False)
class OpenedCluster:
    """Data of the pixels that take part in a cluster, (N, …), and the threads to use for them."""

    views: ClusterViews
    light: StoredLight
    shading: np.ndarray
    observed: AlbedoData
    part: PartOfScene
    threads: int


def opened(cluster: Cluster, task: ClusterTask, threads: int) -> OpenedCluster:
    """Open masks, correspondences, shading and observations of a cluster, all in files.

    Solving and detail each use some of it for a while, and the solver needs the memory.
    """
    use_threads(threads)
    folder = task.parts.folder
    give_back_garbage()  # of the cluster before: the solver's arrays are elsewhere
    light = read_light(task.inputs["found_light"])
    views = open_cluster(task.inputs, task.cameras, cluster, task.graph.side, on_threads, rim=True)
    views = replace(views, stack=views.stack.in_file(folder))
    shading = views.maps(task.inputs["shading"], on_threads) / light.mean_shading.astype(np.float32)
    kept = views.arrays(task.inputs["observations"], BY_PIXEL, on_threads)
    shading, *observations = in_file([shading, *kept.values()], folder)
    observed = AlbedoData(**dict(zip(kept, observations, strict=True)), glossy=light.glossy)
    del kept
    return OpenedCluster(views, light, shading, observed, _part(views, shading, observed, task), threads)


def weights_of(found: OpenedCluster, task: ClusterTask) -> EdgeWeights:
    """Compute the weights of a cluster's edges."""
    data, typical = found.observed, found.part.typical.light
    least = task.solver.weights.consistency
    return weights_of_edges(found.views.stack, found.shading, data, task.settings.edges, least, typical)


def _part(views: ClusterViews, shading: np.ndarray, observed: AlbedoData, task: ClusterTask) -> PartOfScene:
    """Tell which pixels of all these are, and what is typical of all."""
    how = task.settings.detail
    if task.typical is None:
        return whole_scene(shading, observed.diffuse, how.log_offset, how.sample_pixels)
    pixels = int(task.graph.pixels.sum())
    return PartOfScene(views.places(task.graph), views.own, pixels, task.typical)
