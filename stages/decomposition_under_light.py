"""Albedo of every view under the light of the stage `lighting`, cluster by cluster of the surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Job, Stage, counted
from stages.photometry.decomposition_record import ALBEDO, ENERGY, OF_TRANSFER
from stages.photometry.decomposition_settings import IGNORED, DecompositionSettings
from stages.photometry.solver_settings import weights_at
from stages.scene.distributions import PICTURES
from stages.scene.memory_of_views import BYTES_OF_LIBRARIES, BYTES_PER_PIXEL_OF_CLUSTER

if TYPE_CHECKING:
    import numpy as np

    from stages.formats.artefacts.light_npz import StoredLight
    from stages.photometry.albedo.albedo_given_light import SmoothAlbedos
    from stages.photometry.albedo_data import AlbedoData
    from stages.photometry.clusters.cluster_views import ClusterViews
    from stages.photometry.clusters.parts import Parts
    from stages.photometry.clusters.surface_clusters import Cluster
    from stages.photometry.clusters.typical_views import ViewGraph
    from stages.photometry.decomposition_record import Solution
    from stages.photometry.detail.albedo_detail import Detail
    from stages.photometry.detail.part_of_scene import PartOfScene, TypicalPixel
    from stages.photometry.detail.scene_statistics import DetailStatistics, SampledDetail
    from stages.photometry.joint.fast_alternation import FastSolver
    from stages.scene.cameras import Camera

MAPS = ("albedo", "albedo_tv", "confidence")
BYTES_PER_PIXEL = 400  # that take part, all channels together
BYTES_PER_LINK = 40


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


def run(job: Job[DecompositionSettings]) -> None:
    """Divide the surface into clusters, solve each, measure what is common to all, add the detail."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.photometry.clusters.cluster_views import divided_surface, view_graph
    from stages.photometry.clusters.parts import Parts
    from stages.photometry.clusters.surface_clusters import tell_too_large
    from stages.photometry.decomposition_record import write_solutions
    from stages.photometry.detail.scene_statistics import DetailStatistics, SampledDetail
    from stages.photometry.joint.fast_alternation import FastSolver

    cameras, settings, inputs = read_cameras(job.inputs["cameras"]), job.settings, dict(job.inputs)
    graph = view_graph(inputs, cameras)
    clusters = divided_surface(inputs, cameras, graph, settings.clusters, job.executor.map)
    tell_too_large(job, clusters, settings.clusters)
    weights = weights_at(settings, graph.side, graph.links_per_pixel)
    task = ClusterTask(
        inputs,
        Parts(job.scratch, inputs, cameras, clusters),
        cameras,
        graph,
        _typical(job, cameras, graph) if len(clusters) > 1 else None,
        FastSolver(weights, settings.stopping, settings.fast),
        settings,
    )
    if len(clusters) == 1:
        with job.progress("rounds", 2 * settings.stopping.max_rounds, at_most=True) as step:
            whole, sample = solve_whole(clusters[0], task, job.threads, step)
        solutions, statistics = [whole], DetailStatistics.of(sample, settings.detail)
    else:
        job.say(f"The surface is solved in {len(clusters)} clusters.")
        with job.progress("clusters", 2 * len(clusters)) as step:
            drafts, samples = zip(*counted(job.tasks.large(begin_cluster, clusters, task), step), strict=True)
            statistics = DetailStatistics.of(SampledDetail.joined(samples), settings.detail)
            begun = list(zip(clusters, drafts, strict=True))
            solutions = list(counted(job.tasks.large(finish_cluster, begun, statistics, task), step))
    with job.progress("views", len(cameras)) as step:
        folders = {name: job.outputs[name] for name in MAPS}
        for _ in job.tasks.small(write_view, range(len(cameras)), task.parts, folders):
            step()
    job.note(
        weights={"lambda": weights.smoothness, "mu": weights.consistency},
        uncertainty=statistics.uncertainty.as_json(),
        clusters=[solution.pixels for solution in solutions],
        pixels_with_margins=sum(solution.pixels_with_margin for solution in solutions),
    )
    write_solutions(job, solutions)


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
    import numpy as np

    opened = _opened(cluster, task, threads)
    smooth = _smooth(task, opened, cluster, lambda: None)
    np.save(_smooth_file(task, cluster), smooth.by_edge.albedo)
    return _draft(opened, smooth), _with_detail(task, opened, smooth.by_edge.albedo, None).sample


def finish_cluster(
    begun: tuple[Cluster, Solution], common: DetailStatistics, task: ClusterTask, threads: int
) -> Solution:
    """Add the detail to a cluster's smooth albedo, by statistics of all; keep its maps. Picklable."""
    import numpy as np

    cluster, draft = begun
    opened = _opened(cluster, task, threads)
    albedo = np.load(_smooth_file(task, cluster), allow_pickle=False)
    return _kept(task, opened, cluster, _with_detail(task, opened, albedo, common), draft)


def write_view(view: int, parts: Parts, folders: Mapping[str, Path]) -> None:
    """Write the maps of a view, out of clusters. Picklable."""
    from stages.formats.artefacts.view_files import write_maps

    mask, values = parts.of_view(view, MAPS)
    for name, folder in folders.items():
        write_maps(folder, [parts.cameras[view]], [mask], values[name])


def _smooth_file(task: ClusterTask, cluster: Cluster) -> Path:
    return task.parts.folder / f"{cluster.number}_smooth_albedo_with_margin.npy"


def _typical(job: Job[DecompositionSettings], cameras: list[Camera], graph: ViewGraph) -> TypicalPixel:
    """Find what is typical of all views, from the pixels that one cluster of all of them would sample."""
    import numpy as np

    from stages.formats.artefacts.light_npz import read_light
    from stages.formats.artefacts.view_files import read_arrays, read_maps
    from stages.formats.images.photos import read_mask
    from stages.photometry.detail.part_of_scene import TypicalPixel, stride

    mean = read_light(job.inputs["found_light"]).mean_shading.astype(np.float32)
    every = stride(int(graph.pixels.sum()), job.settings.detail.sample_pixels)
    before = graph.starts

    def some(view: int) -> tuple[np.ndarray, np.ndarray]:
        mask = read_mask(job.inputs["mask"] / f"{cameras[view].name}.png")
        kept = (before[view] + np.arange(graph.pixels[view])) % every == 0
        shading = read_maps(job.inputs["shading"], [cameras[view]], [mask])[kept] / mean
        return shading, read_arrays(job.inputs["observations"], [cameras[view]], ["diffuse"], map, [kept])[
            "diffuse"
        ]

    shading, image = zip(*job.executor.map(some, range(len(cameras))), strict=True)
    return TypicalPixel.of(np.concatenate(shading), np.concatenate(image), job.settings.detail.log_offset)


def _opened(cluster: Cluster, task: ClusterTask, threads: int) -> OpenedCluster:
    """Open masks, correspondences, shading and observations of a cluster."""
    import numpy as np

    from pipeline.process.free_memory import give_back_free_memory
    from stages.formats.artefacts.light_npz import read_light
    from stages.photometry.albedo_data import BY_PIXEL, AlbedoData
    from stages.photometry.clusters.cluster_views import open_cluster
    from stages.solvers.kernels.pixelwise import on_threads
    from stages.solvers.kernels.threading_layer import use_threads

    use_threads(threads)
    give_back_free_memory()  # of the cluster before: the solver's arrays are elsewhere
    light = read_light(task.inputs["found_light"])
    views = open_cluster(task.inputs, task.cameras, cluster, task.graph.side, on_threads)
    shading = views.maps(task.inputs["shading"], on_threads) / light.mean_shading.astype(np.float32)
    kept = views.arrays(task.inputs["observations"], BY_PIXEL, on_threads)
    observed = AlbedoData(**kept, glossy=light.glossy)
    return OpenedCluster(views, light, shading, observed, _part(views, shading, observed, task), threads)


def _part(views: ClusterViews, shading: np.ndarray, observed: AlbedoData, task: ClusterTask) -> PartOfScene:
    """Tell which pixels of all these are, and what is typical of all."""
    from stages.photometry.detail.part_of_scene import PartOfScene, whole_scene

    how = task.settings.detail
    if task.typical is None:
        return whole_scene(shading, observed.diffuse, how.log_offset, how.sample_pixels)
    pixels = int(task.graph.pixels.sum())
    return PartOfScene(views.places(task.graph), views.own, pixels, task.typical)


def _smooth(
    task: ClusterTask, opened: OpenedCluster, cluster: Cluster, step: Callable[[], None]
) -> SmoothAlbedos:
    """Estimate the smooth albedos, and keep that of Eq. 2."""
    import numpy as np

    from stages.photometry.albedo.albedo_given_light import smooth_albedos_under_light

    smooth = smooth_albedos_under_light(
        opened.views.stack,
        opened.shading,
        opened.observed,
        task.settings.edges,
        task.solver,
        opened.part.typical.light,
        opened.threads,
        step,
    )
    of_energy = np.maximum(smooth.alike.albedo, 0) * _unit(opened)
    task.parts.keep(cluster, opened.views, {"albedo_tv": of_energy})
    return smooth


def _with_detail(
    task: ClusterTask, opened: OpenedCluster, albedo: np.ndarray, common: DetailStatistics | None
) -> Detail:
    """Add the detail to a smooth albedo, by common statistics, or by its own."""
    from stages.photometry.detail.albedo_detail import with_detail
    from stages.solvers.kernels.threading_layer import use_threads

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
    )


def _draft(opened: OpenedCluster, smooth: SmoothAlbedos) -> Solution:
    """Report the smooth albedo of a cluster."""
    from stages.photometry.decomposition_record import Solution, below_zero
    from stages.photometry.energy_history import rounds_under_light_as_json
    from stages.photometry.paper.alternation import worse

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
    from stages.photometry.albedo.confidence import confidence_of
    from stages.photometry.decomposition_record import below_zero

    trusted = opened.observed.trusted & opened.light.trusted  # if none is, all are used: a guess
    albedo = detail.albedo * _unit(opened)
    confidence = confidence_of(detail.variance, trusted, task.settings.confidence)
    task.parts.keep(cluster, opened.views, {"albedo": albedo, "confidence": confidence})
    negative = below_zero(albedo[opened.views.own])
    return replace(draft, negative_albedo=negative)


def _unit(opened: OpenedCluster) -> Any:
    """Compute the images' unit over that of the shading, per channel, (3,), float32."""
    import numpy as np

    return np.float32(opened.light.image_scale) / opened.light.mean_shading.astype(np.float32)


def estimated_memory(settings: DecompositionSettings, inputs: Mapping[str, Path], threads: int) -> int:
    """Estimate the memory of the largest cluster."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.photometry.clusters.cluster_views import view_graph
    from stages.photometry.clusters.settings import expected_size

    graph = view_graph(inputs, read_cameras(inputs["cameras"]))
    pixels = expected_size(int(graph.pixels.sum()), settings.clusters)
    per_pixel = BYTES_PER_PIXEL + BYTES_PER_LINK * graph.links_per_pixel / 2
    return BYTES_OF_LIBRARIES + int(per_pixel * pixels)


def within(settings: DecompositionSettings, memory: int) -> DecompositionSettings:
    """Make clusters small enough for the memory, bytes."""
    room = (memory - BYTES_OF_LIBRARIES) // BYTES_PER_PIXEL_OF_CLUSTER
    return settings.model_copy(update={"clusters": settings.clusters.within(room)})


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"albedo of {facts['pixels']:,} pixels, which {facts['links']:,} correspondences tie together"


DECOMPOSITION_UNDER_LIGHT = Stage(
    name="decomposition",
    version=47,  # ahead of the other variants
    about="Albedo of each view under the light that was found, from all views together.",
    settings=DecompositionSettings,
    takes=("mask", "depth", "cameras", "correspondences", "found_light", "shading", "observations"),
    gives=(ALBEDO, ENERGY, *OF_TRANSFER),
    ignores=IGNORED["directions"],
    run=run,
    tools=("numpy", "scipy", "numba", "llvmlite", *PICTURES),
    memory=estimated_memory,
    within=within,
    saves_memory="lower decomposition.clusters.pixels, or give --memory",
    found=in_words,
)
