"""Exact optima under fixed light: cuts against linear programs, `PrimalDual` and its bounds against both."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.photometry.joint.problem_assembly import graph_of
from stages.photometry.joint.settings import FastSettings
from stages.photometry.paper.energy import EnergyWeights
from stages.photometry.stack import stack_pixels
from stages.solvers.kernels.threading_layer import use_threads
from stages.solvers.primal_dual.half_edges import HalfEdges
from tests.fixed_light import albedo_of, fixed_light
from tests.linked_graphs import exact_energy, random_views, variation
from tests.minimum_cuts import best_by_cuts
from tests.sphere_scene import sphere_scene

SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(deadline=None, max_examples=15, derandomize=True)
SMOOTHNESS, CONSISTENCY = st.sampled_from([0.05, 0.3, 2.0]), st.sampled_from([0.0, 0.3, 2.0])
ROUNDING = 1e-5  # relative: bounds are made of float32


@pytest.fixture(autouse=True)
def one_thread(threads_as_found: None) -> None:
    """Small problems want no second thread."""
    use_threads(1)


def energy(graph: HalfEdges, image: np.ndarray, shading: np.ndarray, albedo: np.ndarray) -> float:
    return float(np.abs(image - shading * albedo).sum()) + variation(graph, albedo)


def random_shading(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Of either sign, some of it exactly 0."""
    size = rng.uniform(0.3, 1.5, shape) * rng.choice([0.0, 1.0], shape, p=[0.15, 0.85])
    return size * rng.choice([-1.0, 1.0], shape, p=[0.2, 0.8])


# The cuts


@given(SEEDS, SMOOTHNESS, CONSISTENCY)
@FEW
def test_the_cuts_find_the_optimum_of_the_linear_program(seed, smoothness, consistency):
    """Eq. 10, exactly."""
    rng = np.random.default_rng(seed)
    graph = graph_of(random_views(rng, side=5), EnergyWeights(smoothness, consistency))
    image, shading = rng.random(graph.size), random_shading(rng, (graph.size,))
    found = energy(graph, image, shading, best_by_cuts(graph, image, shading))
    assert found == pytest.approx(exact_energy(graph, image, shading), rel=1e-6, abs=1e-9)


@given(SEEDS)
@FEW
def test_of_a_few_levels_the_cuts_find_the_best(seed):
    """Every albedo of five pixels and three levels, which are no quotients, is tried."""
    rng = np.random.default_rng(seed)
    views = random_views(rng, view_count=2, side=2)
    graph = graph_of(views, EnergyWeights(0.4, 0.3))
    image, shading, levels = (
        rng.random(graph.size),
        random_shading(rng, (graph.size,)),
        np.sort(rng.random(3)),
    )
    every = np.stack(np.meshgrid(*graph.size * [levels], indexing="ij"), -1).reshape(-1, graph.size)
    best = min(energy(graph, image, shading, albedo) for albedo in every)
    found = best_by_cuts(graph, image, shading, levels)
    assert set(found) <= set(levels)
    assert energy(graph, image, shading, found) == pytest.approx(best, rel=1e-12)


def test_without_edges_the_cuts_leave_image_over_shading():
    rng = np.random.default_rng(0)
    graph = graph_of(random_views(rng), EnergyWeights(0.0, 0.0))
    image, shading = rng.random(graph.size), random_shading(rng, (graph.size,))
    found, lit = best_by_cuts(graph, image, shading), shading != 0
    assert np.array_equal(found[lit], image[lit] / shading[lit])
    assert not best_by_cuts(graph, image, np.zeros(graph.size)).any()


# The bounds


def small_problem(
    seed: int, smoothness: float, consistency: float
) -> tuple[HalfEdges, np.ndarray, np.ndarray]:
    """Graph, image and shading, (N, 3) each, for a linear program."""
    rng = np.random.default_rng(seed)
    graph = graph_of(random_views(rng, side=4), EnergyWeights(smoothness, consistency))
    image = rng.random((graph.size, 3))
    return graph, as_float32(image), as_float32(random_shading(rng, image.shape))


def as_float32(values: np.ndarray) -> np.ndarray:
    """What the scheme sees, in the precision of its judges."""
    return values.astype(np.float32).astype(np.float64)


@given(SEEDS, SMOOTHNESS, CONSISTENCY, st.sampled_from([0, 1, 3, 10, 30, 100, 1000]))
@FEW
def test_the_optimum_lies_between_the_bound_and_the_energy(seed, smoothness, consistency, count):
    """At every stage of the way."""
    graph, image, shading = small_problem(seed, smoothness, consistency)
    solver = fixed_light(graph, image, shading)
    solver.iterate(count)
    bounds, albedo = solver.bounds(FastSettings().gap_ranges), albedo_of(solver).astype(np.float64)
    for c in range(3):
        found = energy(graph, image[:, c], shading[:, c], albedo[:, c])
        best = exact_energy(graph, image[:, c], shading[:, c])
        slack = ROUNDING * (found + image[:, c].sum())
        assert bounds.energy[c] == pytest.approx(found, abs=slack)
        assert bounds.least[c] - slack <= best <= found + slack


@given(SEEDS, st.sampled_from([0.0, 1e-3, 0.05]), st.sampled_from([30, 1000]))
@FEW
def test_nor_do_pixels_that_are_nearly_dark_lift_the_bound(seed, smoothness, count):
    """Loosely tied to others, they fit with an albedo far beyond anyone else's, and cost nothing."""
    graph, image, shading = small_problem(seed, smoothness, 0.0)
    dark = np.random.default_rng(seed).random(graph.size) < 0.2
    shading[dark] = as_float32(0.01 * shading[dark])
    solver = fixed_light(graph, image, shading)
    solver.iterate(count)
    least = solver.bounds(FastSettings().gap_ranges).least
    for c in range(3):
        best = exact_energy(graph, image[:, c], shading[:, c])
        assert least[c] <= best + ROUNDING * image[:, c].sum()


@given(SEEDS, SMOOTHNESS, CONSISTENCY)
@FEW
def test_the_bound_and_the_energy_meet(seed, smoothness, consistency):
    graph, image, shading = small_problem(seed, smoothness, consistency)
    solver = fixed_light(graph, image, shading)
    solver.iterate(6000)
    bounds = solver.bounds(FastSettings().gap_ranges)
    assert np.all(bounds.energy - bounds.least <= 1e-3 * bounds.energy + 1e-4)


# Where linear programs are out of reach


def noisy_sphere(width: int, smoothness: float) -> tuple[HalfEdges, np.ndarray, np.ndarray]:
    """Four linked views, with noise, under a light of too little contrast."""
    scene = sphere_scene(4, width, width * 5 // 6)
    image, shading = np.stack(scene.channels(), axis=1), stack_pixels(scene.masks, scene.shadings)
    image *= 1 + 0.05 * np.random.default_rng(0).standard_normal(image.shape)
    flat = np.sign(shading) * np.abs(shading / shading.mean()) ** 0.7
    graph = graph_of(scene.stacked(), EnergyWeights(smoothness, 1.0))
    return graph, as_float32(image), as_float32(flat[:, None].repeat(3, axis=1))


@pytest.mark.parametrize(("width", "smoothness", "count"), [(96, 1.0, 800), (64, 10.0, 4000)])
def test_the_scheme_comes_within_a_thousandth_of_the_optimum_of_a_scene(width, smoothness, count):
    """17,000 and 8,000 pixels; strong smoothness, whose news travels far, takes longer.

    All quotients are levels of the cuts: their optimum is that of the energy, not of a quantised one.
    """
    graph, image, shading = noisy_sphere(width, smoothness)
    solver = fixed_light(graph, image, shading)
    solver.iterate(count)
    least, albedo = solver.bounds(FastSettings().gap_ranges).least, albedo_of(solver).astype(np.float64)
    for c in range(3):
        own = graph, image[:, c], shading[:, c]
        best, found = energy(*own, best_by_cuts(*own)), energy(*own, albedo[:, c])
        assert best * (1 - ROUNDING) <= found <= best * 1.001
        assert least[c] <= best * (1 + ROUNDING)
