"""Albedo of every view under the light of the stage `lighting`, cluster by cluster of the surface."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Job, Stage, counted
from stages.photometry.decomposition_record import ALBEDO, ENERGY, OF_TRANSFER
from stages.photometry.decomposition_settings import IGNORED, DecompositionSettings
from stages.photometry.solver_settings import weights_at
from stages.scene.distributions import PICTURES
from stages.scene.memory_of_views import (
    BYTES_OF_ALBEDO,
    BYTES_OF_LIBRARIES,
    BYTES_PER_PIXEL_OF_CLUSTER,
    left_for_pixels,
)

if TYPE_CHECKING:
    import numpy as np

    from stages.photometry.albedo_of_clusters.opened_cluster import ClusterTask
    from stages.photometry.clusters.parts import Parts
    from stages.photometry.clusters.typical_views import ViewGraph
    from stages.photometry.decomposition_record import Solution
    from stages.photometry.detail.detail_scene import TypicalPixel
    from stages.photometry.detail.scene_statistics import DetailStatistics
    from stages.scene.cameras import Camera

MAPS = ("albedo", "albedo_tv", "confidence")
BYTES_PER_PIXEL = 200  # that take part, all channels together
BYTES_PER_LINK = 48


def run(job: Job[DecompositionSettings]) -> None:
    """Divide the surface into clusters, solve each, measure what is common to all, add the detail."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.photometry.albedo_of_clusters.opened_cluster import ClusterTask
    from stages.photometry.clusters.cluster_views import divided_surface, view_graph
    from stages.photometry.clusters.parts import Parts
    from stages.photometry.clusters.surface_clusters import tell_too_large
    from stages.photometry.decomposition_record import write_solutions
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
    solutions, statistics = _as_one(job, task) if len(clusters) == 1 else _in_clusters(job, task)
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


def _as_one(job: Job[DecompositionSettings], task: ClusterTask) -> tuple[list[Solution], DetailStatistics]:
    """Solve the only cluster, with its detail by its own statistics."""
    from stages.photometry.albedo_of_clusters.solved_clusters import solve_whole

    (whole,) = task.parts.clusters
    with job.progress("rounds", 2 * job.settings.stopping.max_rounds, at_most=True) as step:
        solution, statistics = solve_whole(whole, task, job.threads, step)
    return [solution], statistics


def _in_clusters(
    job: Job[DecompositionSettings], task: ClusterTask
) -> tuple[list[Solution], DetailStatistics]:
    """Solve coarse levels of all, each cluster from there, and add the detail by statistics of all."""
    from stages.photometry.albedo.albedo_given_light import KINDS
    from stages.photometry.albedo_of_clusters.common_levels import add_up_cluster, solve_coarse_levels
    from stages.photometry.albedo_of_clusters.solved_clusters import begin_cluster, finish_cluster
    from stages.photometry.detail.scene_statistics import DetailStatistics, SampledDetail

    clusters, large = task.parts.clusters, job.tasks.large
    job.say(f"The surface is solved in {len(clusters)} clusters.")
    with job.progress("clusters", 3 * len(clusters) + len(KINDS)) as step:
        list(counted(large(add_up_cluster, clusters, task), step))
        list(counted(large(solve_coarse_levels, KINDS, task), step))
        drafts, samples = zip(*counted(large(begin_cluster, clusters, task), step), strict=True)
        statistics = DetailStatistics.of(SampledDetail.joined(samples), job.settings.detail)
        begun = list(zip(clusters, drafts, strict=True))
        solutions = list(counted(large(finish_cluster, begun, statistics, task), step))
    return solutions, statistics


def write_view(view: int, parts: Parts, folders: Mapping[str, Path]) -> None:
    """Write the maps of a view, out of clusters. Picklable."""
    from stages.formats.artefacts.view_files import write_maps

    mask, values = parts.of_view(view, MAPS)
    for name, folder in folders.items():
        write_maps(folder, [parts.cameras[view]], [mask], values[name])


def _typical(job: Job[DecompositionSettings], cameras: list[Camera], graph: ViewGraph) -> TypicalPixel:
    """Find what is typical of all views, from the pixels that one cluster of all of them would sample."""
    import numpy as np

    from stages.formats.artefacts.light_npz import read_light
    from stages.formats.artefacts.view_files import read_arrays, read_maps
    from stages.formats.images.photos import read_mask
    from stages.photometry.detail.detail_scene import TypicalPixel, stride

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


def estimated_memory(settings: DecompositionSettings, inputs: Mapping[str, Path], threads: int) -> int:
    """Estimate the memory of the largest cluster."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.photometry.clusters.cluster_views import view_graph
    from stages.photometry.clusters.settings import expected_size

    graph = view_graph(inputs, read_cameras(inputs["cameras"]))
    pixels = expected_size(int(graph.pixels.sum()), settings.clusters)
    per_pixel = BYTES_PER_PIXEL + BYTES_PER_LINK * graph.links_per_pixel / 2
    return BYTES_OF_LIBRARIES + BYTES_OF_ALBEDO + int(per_pixel * pixels)


def within(settings: DecompositionSettings, memory: int) -> DecompositionSettings:
    """Make clusters small enough for the memory, bytes."""
    room = left_for_pixels(memory) // BYTES_PER_PIXEL_OF_CLUSTER
    return settings.model_copy(update={"clusters": settings.clusters.within(room)})


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"albedo of {facts['pixels']:,} pixels, which {facts['links']:,} correspondences tie together"


DECOMPOSITION_UNDER_LIGHT = Stage(
    name="decomposition",
    version=57,  # ahead of the other variants
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
