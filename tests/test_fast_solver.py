"""`solver: fast`: graph and pyramid keep the energy of Eq. 2, its steps find known optima, it ends well."""

from __future__ import annotations

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from stages.correspondence import CORRESPONDENCE
from stages.decomposition import DECOMPOSITION, DecompositionSettings
from stages.photometry import fast_alternation
from stages.photometry.alternation import AlternationSettings, Outcome, decompose_channels
from stages.photometry.energy import EnergyWeights, energy_terms
from stages.photometry.fast_alternation import FastDescent, FastSettings, solve
from stages.photometry.light_refit import ViewBlocks, refit_light, shading_of
from stages.photometry.light_step import light_step
from stages.photometry.pyramid import Level, coarser, pyramid
from stages.photometry.stack import StackedViews, stack_views
from stages.scene.exr import read_exr
from stages.solvers.half_edges import HalfEdges, aggregated, from_edges, half_edges
from stages.solvers.primal_dual_graph import PrimalDual
from stages.solvers.threading_layer import use_threads
from tests.sphere_scene import SphereScene, sphere_scene
from tests.test_decomposition_stage import write_scene

SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(deadline=None, max_examples=20, derandomize=True)
WEIGHTS = EnergyWeights(smoothness=2.0, consistency=1.5, delta=1e-4)
FAST = FastSettings(WEIGHTS, fewest_pixels=30)
ONE_THREAD = 1


@pytest.fixture(autouse=True)
def threads_as_found() -> Iterator[None]:
    yield
    use_threads(10_000)


def random_views(rng: np.random.Generator, view_count: int = 3, side: int = 7) -> StackedViews:
    """Views with holes, odd sizes and random links; never empty, not always linked."""
    masks, normals, links = [], [], {}
    for _ in range(view_count):
        mask = rng.random(tuple(rng.integers(1, side + 1, 2))) < 0.75
        mask[rng.integers(mask.shape[0]), rng.integers(mask.shape[1])] = True
        normal = rng.standard_normal((*mask.shape, 3))
        masks.append(mask)
        normals.append(normal / np.linalg.norm(normal, axis=-1, keepdims=True))
    for i, j in combinations(range(view_count), 2):
        shape = int(masks[i].sum()), int(masks[j].sum())
        linked = np.flatnonzero(rng.random(shape[0]) < 0.4)
        partner = rng.integers(shape[1], size=linked.size)
        links[i, j] = sp.csr_array((np.ones(linked.size, np.uint8), (linked, partner)), shape=shape)
    return stack_views(masks, normals, links)


def graph_of(views: StackedViews, weights: EnergyWeights) -> HalfEdges:
    by_smoothness = [(views.d_x, weights.smoothness), (views.d_y, weights.smoothness)]
    return half_edges([*by_smoothness, (views.c, weights.consistency)])


def variation(graph: HalfEdges, albedo: np.ndarray) -> float:
    """Σ w |ρ_p − ρ_q| over the edges: half of it at either end."""
    owner = np.repeat(np.arange(graph.size), np.diff(graph.first))
    return float(np.sum(graph.weight * np.abs(albedo[owner] - albedo[graph.neighbour])) / 2)


# The graph


@given(SEEDS)
@FEW
def test_the_graph_has_the_variation_of_the_operators(seed):
    """λ times Eq. 4 plus μ times Eq. 5."""
    rng = np.random.default_rng(seed)
    views = random_views(rng)
    albedo = 3 + rng.standard_normal(views.positions.shape[0])
    smooth = np.abs(views.d_x @ albedo).sum() + np.abs(views.d_y @ albedo).sum()
    expected = 2.0 * smooth + 1.5 * np.abs(views.c @ albedo).sum()
    assert variation(graph_of(views, WEIGHTS), albedo) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_edges_between_the_same_two_pixels_add_up():
    graph = from_edges(4, np.array([0, 2, 0]), np.array([2, 0, 1]), np.array([0.5, 0.25, 2.0]))
    assert graph.first.tolist() == [0, 2, 3, 4, 4]
    assert graph.neighbour.tolist() == [1, 2, 0, 0]
    assert graph.weight.tolist() == [2.0, 0.75, 2.0, 0.75]
    assert from_edges(2, np.array([0]), np.array([1]), np.array([0.0])).neighbour.size == 0


@given(SEEDS)
@FEW
def test_both_ends_of_an_edge_weigh_the_same_to_the_last_bit(seed):
    """What keeps the two copies of a dual each other's negatives; edges come in either direction."""
    rng = np.random.default_rng(seed)
    tail, shift = rng.integers(40, size=800), rng.integers(1, 40, size=800)
    graph = from_edges(40, tail, (tail + shift) % 40, rng.random(800))
    matrix = sp.csr_array((graph.weight, graph.neighbour, graph.first), shape=(40, 40)).toarray()
    assert np.array_equal(matrix, matrix.T)


@given(SEEDS)
@FEW
def test_groups_have_the_variation_of_their_pixels(seed):
    """A ρ that is constant on every group, before and after aggregation."""
    rng = np.random.default_rng(seed)
    graph = graph_of(random_views(rng), WEIGHTS)
    count = int(rng.integers(1, graph.size + 1))
    group = rng.integers(count, size=graph.size)
    of_groups = 3 + rng.standard_normal(count)
    together = aggregated(graph, group, count)
    assert together.size == count
    assert variation(together, of_groups) == pytest.approx(variation(graph, of_groups[group]), rel=1e-5)
    owner = np.repeat(np.arange(count), np.diff(together.first))
    assert not np.any(owner == together.neighbour)


# The pyramid


def level_of(views: StackedViews, image: np.ndarray) -> Level:
    basis = views.basis.astype(np.float32)
    return Level(views.starts, views.positions, basis, image.astype(np.float32), graph_of(views, WEIGHTS))


@given(SEEDS)
@FEW
def test_a_coarser_level_is_the_same_problem_on_groups(seed):
    """Views stay apart, positions halve; a ρ of the groups has a quarter of Eq. 2's signed residuals."""
    rng = np.random.default_rng(seed)
    views = random_views(rng)
    fine = level_of(views, rng.random((views.positions.shape[0], 3)))
    coarse = coarser(fine)
    group = coarse.group
    assert np.array_equal(coarse.view_of_pixel[group], fine.view_of_pixel)
    assert np.array_equal(coarse.positions[group], fine.positions // 2)
    places = np.column_stack([coarse.view_of_pixel, coarse.positions])
    assert len(np.unique(places, axis=0)) == len(places)
    assert len(np.unique(group)) == len(places)

    light, albedo = rng.standard_normal((3, 9)), rng.random(len(places))
    residual_of = [
        level.image[:, 0] - rho * np.einsum("pk,pk->p", level.basis, light[level.view_of_pixel])
        for level, rho in ((fine, albedo[group]), (coarse, albedo))
    ]
    sums = np.bincount(group, residual_of[0]) / 4
    assert np.allclose(sums, residual_of[1], atol=1e-5)
    assert 4 * variation(coarse.graph, albedo) == pytest.approx(
        variation(fine.graph, albedo[group]), rel=1e-5
    )


def test_a_full_group_keeps_its_data_its_smoothness_halves_and_its_agreement_stays():
    """Two views of 4 × 4 equal pixels, linked one to one: by hand."""
    mask, normals = np.ones((4, 4), bool), np.broadcast_to([0.0, 0, 1], (4, 4, 3))
    views = stack_views([mask, mask], [normals] * 2, {(0, 1): sp.identity(16, format="csr", dtype=np.uint8)})
    coarse = coarser(level_of(views, np.broadcast_to([0.2, 0.4, 0.8], (32, 3))))
    assert coarse.starts.tolist() == [0, 4, 8]
    assert coarse.positions.tolist() == 2 * [[0, 0], [0, 1], [1, 0], [1, 1]]
    assert np.allclose(coarse.image, [0.2, 0.4, 0.8])
    assert np.allclose(coarse.basis, views.basis[0])
    assert coarse.graph.neighbour[:3].tolist() == [1, 2, 4]
    assert coarse.graph.weight[:3].tolist() == [WEIGHTS.smoothness / 2] * 2 + [WEIGHTS.consistency]


def test_the_pyramid_goes_from_coarse_to_the_given_level_and_stops_in_time():
    views = sphere_scene(3, 24, 20).stacked()
    finest = level_of(views, np.ones((views.positions.shape[0], 3)))
    levels = pyramid(finest, 10)
    assert levels[-1] is finest
    assert len(levels) > 2
    for coarse, fine in zip(levels, levels[1:], strict=False):
        assert coarse.group.shape == (fine.image.shape[0],)
        assert coarse.image.shape[0] == coarse.group.max() + 1 < fine.image.shape[0]
    assert levels[0].image.shape[0] >= 30
    assert pyramid(finest, 10**6) == [finest]


# The albedo step


def exact_energy(graph: HalfEdges, image: np.ndarray, shading: np.ndarray) -> float:
    """Least Σ|I − S ρ| + Σ w |ρ_p − ρ_q| of one channel: a linear program in (ρ, |I − S ρ|, |Dρ|)."""
    count = graph.size
    owner = np.repeat(np.arange(count), np.diff(graph.first))
    once = owner < graph.neighbour
    tail, head, weight = owner[once], graph.neighbour[once], graph.weight[once].astype(float)
    edges = np.arange(tail.size)
    d = sp.csr_array((np.ones(tail.size), (edges, head)), shape=(tail.size, count))
    d = d - sp.csr_array((np.ones(tail.size), (edges, tail)), shape=(tail.size, count))
    s, each, between = sp.diags_array(shading), sp.eye_array(count), sp.eye_array(tail.size)
    above = sp.block_array(
        [[s, -each, None], [-s, -each, None], [d, None, -between], [-d, None, -between]], format="csc"
    )
    bounds = [(None, None)] * count + [(0, None)] * (count + tail.size)
    found = linprog(
        np.concatenate([np.zeros(count), np.ones(count), weight]),
        A_ub=above,
        b_ub=np.concatenate([image, -image, np.zeros(2 * tail.size)]),
        bounds=bounds,
        method="highs",
    )
    assert found.status == 0
    return float(found.fun)


def random_shading(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Of either sign, some of it exactly 0."""
    size = rng.uniform(0.3, 1.5, shape) * rng.choice([0.0, 1.0], shape, p=[0.15, 0.85])
    return (size * rng.choice([-1.0, 1.0], shape, p=[0.2, 0.8])).astype(np.float32)


def solved(graph, image, shading, scale=0.1, count=6000) -> np.ndarray:
    use_threads(ONE_THREAD)
    solver = PrimalDual(graph, image, scale)
    solver.iterate(image, shading, count)
    return solver.albedo


@given(SEEDS, st.sampled_from([0.05, 0.3, 2.0]), st.sampled_from([0.0, 0.3, 2.0]))
@FEW
def test_eq_10_at_fixed_light_the_optimum_is_that_of_a_linear_program(seed, smoothness, consistency):
    """Eq. 10 to 0.1 %, on grids linked across views, S of both signs and 0."""
    rng = np.random.default_rng(seed)
    views = random_views(rng, side=4)
    graph = graph_of(views, EnergyWeights(smoothness, consistency, 1e-4))
    image = rng.random((graph.size, 3)).astype(np.float32)
    shading = random_shading(rng, image.shape)
    albedo = solved(graph, image, shading).astype(float)
    for c in range(3):
        found = np.abs(image[:, c] - shading[:, c] * albedo[:, c]).sum() + variation(graph, albedo[:, c])
        best = exact_energy(graph, image[:, c].astype(float), shading[:, c].astype(float))
        assert best * (1 - 1e-5) <= found <= best * (1 + 1e-3) + 1e-6


def test_without_lambda_and_mu_the_fast_albedo_is_image_over_shading():
    """Wherever S ≠ 0; where S = 0 the albedo stays as it was."""
    rng = np.random.default_rng(1)
    graph = graph_of(random_views(rng), EnergyWeights(0.0, 0.0, 1e-4))
    image = rng.random((graph.size, 3)).astype(np.float32)
    shading = random_shading(rng, image.shape)
    albedo, lit = solved(graph, image, shading), shading != 0
    assert 0 < lit.sum() < lit.size
    assert np.allclose(albedo[lit], image[lit] / shading[lit], rtol=1e-6)
    assert np.array_equal(albedo[~lit], image[~lit])


def test_a_heavy_edge_makes_its_two_pixels_equal():
    """Between 0.2 and 0.8 under unequal light: the better lit pixel has its way. A light edge parts them."""
    image = np.array([[0.2], [0.8 * 0.5]], np.float32).repeat(3, axis=1)
    shading = np.array([[1.0], [0.5]], np.float32).repeat(3, axis=1)
    heavy, light = (from_edges(2, np.array([0]), np.array([1]), np.array([w])) for w in (1e4, 0.3))
    assert np.allclose(solved(heavy, image, shading), 0.2, atol=1e-6)
    assert np.allclose(solved(light, image, shading)[:, 0], [0.2, 0.8], atol=1e-6)


def test_the_albedo_step_gives_the_same_bits_on_one_thread_and_on_two():
    rng = np.random.default_rng(2)
    graph = graph_of(random_views(rng, view_count=4, side=40), WEIGHTS)
    image, shading = rng.random((2, graph.size, 3)).astype(np.float32)
    found = []
    for threads in (1, 2):
        use_threads(threads)
        solver = PrimalDual(graph, image, 0.03)
        solver.iterate(image, shading, 40)
        found.append(solver.albedo)
    assert np.array_equal(*found)
    assert not np.array_equal(found[0], image)


# The light


@pytest.fixture(scope="module")
def unlinked() -> tuple[StackedViews, np.ndarray, np.ndarray, np.ndarray]:
    """Three views, the second empty, the others of several blocks: views, image, albedo (N, 3), light.

    Some albedo is 0, some below.
    """
    rng = np.random.default_rng(3)
    sides = (70, 90), (3, 3), (61, 83)
    masks = [rng.random(side) < 0.95 for side in sides]
    masks[1][:] = False
    normals = [rng.standard_normal((*side, 3)) for side in sides]
    views = stack_views(masks, [one / np.linalg.norm(one, axis=-1, keepdims=True) for one in normals], {})
    views = replace(views, basis=views.basis.astype(np.float32).astype(np.float64))
    image, albedo = rng.uniform(0.1, 1, (2, views.positions.shape[0], 3)).astype(np.float32)
    albedo *= rng.choice(np.float32([-1, 0, 1]), albedo.shape, p=[0.1, 0.1, 0.8])
    light = np.tile([2.0] + 8 * [0.2], (3, 3, 1)) + 0.2 * rng.standard_normal((3, 3, 9))
    return views, image, albedo, light


def refitted(views, image, albedo, light, delta=1e-4) -> np.ndarray:
    basis = views.basis.astype(np.float32)
    return refit_light(ViewBlocks(views.starts), basis, image, albedo, light, delta)


def test_eq_11_the_compiled_light_step_is_the_light_step(unlinked):
    """Eq. 11 with Eq. 12's weights, in three channels; the empty view's light is 0 in both."""
    views, image, albedo, light = unlinked
    found = refitted(views, image, albedo, light)
    for c in range(3):
        one = (np.ascontiguousarray(each[:, c], np.float64) for each in (image, albedo))
        expected = light_step(views, *one, light[:, c], 1e-4)
        assert np.allclose(found[:, c], expected, rtol=1e-6, atol=1e-7)
    assert not found[1].any()


def test_eq_1_compiled_shading_is_light_times_basis(unlinked):
    """S = σ·ν of Eq. 1."""
    views, _, _, light = unlinked
    found = shading_of(ViewBlocks(views.starts), views.basis.astype(np.float32), light)
    for c in range(3):
        assert np.allclose(found[:, c], views.shading(light[:, c]), atol=1e-5)


def test_the_light_has_the_same_bits_on_one_thread_and_on_two(unlinked):
    views, _, _, light = unlinked
    assert ViewBlocks(views.starts).views.size > 3
    found = []
    for threads in (1, 2):
        use_threads(threads)
        shading = shading_of(ViewBlocks(views.starts), views.basis.astype(np.float32), light)
        found.append((refitted(*unlinked), shading))
    assert np.array_equal(found[0][0], found[1][0])
    assert np.array_equal(found[0][1], found[1][1])


def test_a_black_channel_has_finite_light(unlinked):
    views, image, albedo, light = unlinked
    image, albedo = image * np.float32([1, 0, 1]), albedo * np.float32([1, 1, 0])
    found = refitted(views, image, albedo, light)
    assert np.isfinite(found).all()
    assert np.abs(found[[0, 2], 0]).max() > 0


# Albedo and light together


def solution(views: StackedViews, images: list[np.ndarray], how: FastSettings = FAST) -> FastDescent:
    return solve(views, images, how, ONE_THREAD, lambda: None)


def terms_of(views: StackedViews, images: list[np.ndarray], descent: FastDescent) -> list:
    return [
        energy_terms(views, image, descent.albedo[:, c].copy(), descent.light[:, c].copy())
        for c, image in enumerate(images)
    ]


def total(terms) -> float:
    return sum(one.total(WEIGHTS) for one in terms)


def assert_in_the_gauge(images: list[np.ndarray], descent: FastDescent) -> None:
    """Σ|ρ| = Σ|I| in every channel."""
    assert np.allclose(np.abs(descent.albedo).sum(axis=0), [np.abs(one).sum() for one in images], rtol=1e-5)


@pytest.fixture(scope="module")
def sphere() -> SphereScene:
    return sphere_scene(3, 24, 20)


@pytest.fixture(scope="module")
def on_sphere(sphere) -> tuple[StackedViews, list[np.ndarray], FastDescent]:
    views, images = sphere.stacked(), sphere.channels()
    return views, images, solution(views, images)


def test_eq_2_ends_no_higher_than_the_paper_s_scheme_and_in_the_gauge(on_sphere):
    """Eq. 2, summed over the channels; the paper's scheme as `mode: paper` has it."""
    views, images, descent = on_sphere
    how = AlternationSettings(WEIGHTS, 50, 1e-3, 1e-6, 1000)
    with ThreadPoolExecutor(1) as executor:
        theirs = decompose_channels(views, images, how, executor)
    assert descent.outcome is Outcome.CONVERGED
    assert total(terms_of(views, images, descent)) <= total(one.state.terms for one in theirs)
    assert_in_the_gauge(images, descent)


def test_the_albedo_it_ends_with_is_optimal_for_the_light_it_ends_with(on_sphere):
    """Eq. 10: to 0.1 % of a linear program's optimum."""
    views, images, descent = on_sphere
    graph, best = graph_of(views, WEIGHTS), 0.0
    for c, image in enumerate(images):
        best += exact_energy(graph, image, views.shading(descent.light[:, c].copy()))
    assert best * (1 - 1e-5) <= total(descent.rounds[-1].terms) <= best * (1 + 1e-3)


@pytest.mark.parametrize(("rounds", "tolerance"), [(1, 0.0), (7, 0.0), (40, 1e-3)])
def test_rounds_hold_the_energy_and_the_last_one_that_of_the_solution(on_sphere, rounds, tolerance):
    """However it ended; no round lies below the solution."""
    views, images, _ = on_sphere
    found = solution(views, images, replace(FAST, max_rounds=rounds, tolerance=tolerance))
    assert tuple(terms_of(views, images, found)) == found.rounds[-1].terms
    assert total(found.rounds[-1].terms) == min(total(one.terms) for one in found.rounds)
    assert len(found.rounds) <= rounds + 2


def test_the_outcome_says_whether_the_rounds_sufficed(on_sphere):
    views, images, descent = on_sphere
    few = solution(views, images, replace(FAST, max_rounds=2, tolerance=1e-9))
    assert few.outcome is Outcome.LIMIT_REACHED
    assert [one.refits for one in few.rounds] == [1, 11, 21]
    assert solution(views, images, replace(FAST, tolerance=0.9)).outcome is Outcome.CONVERGED
    before, last = descent.rounds[-2:]
    assert total(before.terms) - total(last.terms) <= 1e-4 * total(before.terms)


@pytest.mark.parametrize("scale", [0.25, 3.0])
def test_scaling_the_images_scales_the_fast_albedo(on_sphere, scale):
    """I → s I gives ρ → s ρ and the same light, when δ and the steps, which are in I's unit, go along."""
    views, images, _ = on_sphere
    few = replace(FAST, max_rounds=3, tolerance=0.0)
    weights = replace(WEIGHTS, delta=scale * WEIGHTS.delta)
    there = replace(few, weights=weights, step_scale=scale * few.step_scale)
    one, other = solution(views, images, few), solution(views, [scale * each for each in images], there)
    rms = np.sqrt(np.mean((other.albedo / scale - one.albedo) ** 2) / np.mean(one.albedo**2))
    assert rms < (1e-12 if scale == 0.25 else 2e-3)
    assert total(other.rounds[-1].terms) == pytest.approx(scale * total(one.rounds[-1].terms), rel=1e-3)


def test_the_number_of_threads_does_not_change_the_solution(on_sphere, monkeypatch):
    views, images, _ = on_sphere
    monkeypatch.setattr(fast_alternation, "PIXELS_PER_THREAD", 10)
    few = replace(FAST, max_rounds=1, coarse_refits=10)
    one, two = (solve(views, images, few, threads, lambda: None) for threads in (1, 2))
    assert np.array_equal(one.albedo, two.albedo)
    assert np.array_equal(one.light, two.light)
    assert one.rounds == two.rounds


def black_channel(scene: SphereScene) -> None:
    for image in scene.albedos:
        image[..., 1] = 0


def black_everywhere(scene: SphereScene) -> None:
    for image in scene.albedos:
        image[:] = 0


def constant(scene: SphereScene) -> None:
    for i, mask in enumerate(scene.masks):
        scene.albedos[i], scene.shadings[i] = np.where(mask[..., None], [0.5, 0.3, 0.2], 0), 1.0 * mask


def no_links(scene: SphereScene) -> None:
    scene.links.clear()


def lonely_pixel(scene: SphereScene) -> None:
    """A pixel apart from the rest in the first view, and nothing but one in the last."""
    middle = tuple(side // 2 for side in scene.masks[0].shape)
    for i, around in ((0, np.zeros((5, 5), bool)), (2, np.zeros(scene.masks[2].shape, bool))):
        if i == 0:
            window = tuple(slice(m - 2, m + 3) for m in middle)
            scene.masks[0][window] = around
        else:
            scene.masks[2] = around
        scene.masks[i][middle] = True
    scene.links.clear()


def shadow(scene: SphereScene) -> None:
    """Exactly black where it falls: a quarter of every view."""
    for shading in scene.shadings:
        shading[:10, :12] = 0


def empty_view(scene: SphereScene) -> None:
    scene.masks[1] = np.zeros_like(scene.masks[1])
    scene.links.clear()


CASES = [black_channel, black_everywhere, constant, no_links, lonely_pixel, shadow, empty_view]


@pytest.mark.parametrize("change", CASES)
def test_odd_problems_end_in_numbers_and_in_the_gauge(change):
    """Nothing is special: finite, in the gauge, hardly above ρ = I with σ·ν = 1, which the light can do."""
    scene = sphere_scene(3, 24, 20)
    change(scene)
    pixels = np.concatenate([one[mask] for one, mask in zip(scene.images, scene.masks, strict=True)])
    images = [np.ascontiguousarray(channel) / max(pixels.max(), 1e-9) for channel in pixels.T]
    views = scene.stacked()
    descent = solution(views, images, replace(FAST, max_rounds=10))
    assert np.isfinite(descent.albedo).all()
    assert np.isfinite(descent.light).all()
    assert_in_the_gauge(images, descent)
    flat = np.zeros((views.view_count, 9))
    flat[:, 0] = 1 / views.basis[0, 0]
    trivial = [energy_terms(views, image, image, flat).total(WEIGHTS) for image in images]
    brightness = sum(float(image.sum()) for image in images)
    assert total(terms_of(views, images, descent)) <= sum(trivial) + 1e-3 * brightness
    for c, image in enumerate(images):
        if not image.any():
            assert not descent.albedo[:, c].any()


def test_where_the_energy_rises_again_the_best_round_is_kept_and_comes_last():
    """A constant image: the first rounds, still swinging, rise."""
    scene = sphere_scene(3, 24, 20)
    constant(scene)
    views, images = scene.stacked(), scene.channels()
    descent = solution(views, images, replace(FAST, max_rounds=2, tolerance=0.0))
    energies = [total(one.terms) for one in descent.rounds]
    assert energies[0] < energies[1] and energies[0] < energies[2]
    assert descent.rounds[3:] == descent.rounds[:1]
    assert tuple(terms_of(views, images, descent)) == descent.rounds[-1].terms


def test_a_constant_image_is_all_albedo_or_all_shading():
    """Under one light any split costs nothing: the energy goes to 0 and the albedo to the image."""
    scene = sphere_scene(3, 24, 20)
    constant(scene)
    views, images = scene.stacked(), scene.channels()
    descent = solution(views, images, replace(FAST, max_rounds=20))
    assert total(terms_of(views, images, descent)) < 1e-3 * sum(image.sum() for image in images)
    assert np.allclose(descent.albedo, np.stack(images, axis=1), rtol=1e-2)


# The stage


@pytest.fixture(scope="module")
def two_runs(sphere, make_job, tmp_path_factory) -> list:
    """The stage twice on the same files, on one thread and on two."""
    folder = tmp_path_factory.mktemp("fast")
    inputs = write_scene(folder, sphere)
    links = {name: inputs[name] for name in ("depth", "mask", "cameras")}
    linking = make_job(folder / "links", CORRESPONDENCE, **links)
    CORRESPONDENCE.run(linking)
    takes = {name: inputs[name] for name in ("linear", "normal", "mask", "cameras")}
    takes["correspondences"] = linking.outputs["correspondences"]
    how, jobs = DecompositionSettings(solver="fast", fast_max_rounds=30), []
    for threads in (1, 2):
        jobs.append(make_job(folder / str(threads), DECOMPOSITION, how, threads, **takes))
        DECOMPOSITION.run(jobs[-1])
    return jobs


def test_the_stage_leaves_every_artefact_and_the_recorded_energy(sphere, two_runs):
    job = two_runs[0]
    for camera in sphere.cameras:
        maps = [read_exr(job.outputs[name] / f"{camera.name}.exr") for name in ("albedo", "shading")]
        assert all(one.shape == (20, 24, 3) and np.isfinite(one).all() and one.any() for one in maps)
    assert len(json.loads(job.outputs["lighting"].read_text(encoding="utf-8"))["views"]) == 3
    content = json.loads(job.outputs["energy"].read_text(encoding="utf-8"))
    channels = list(content["channels"].values())
    assert list(content["channels"]) == ["red", "green", "blue"]
    assert job.facts["energy"] == sum(one["alternations"][-1]["energy"] for one in channels)
    for one in channels:
        rows = one["alternations"]
        assert rows[-1]["energy"] < rows[0]["energy"]
        assert rows[-1]["energy"] == pytest.approx(
            rows[-1]["photo"] + rows[-1]["smooth"] + rows[-1]["multi_view"], rel=1e-12
        )
        assert one["outcome"] in ("converged", "limit_reached")
    assert len(job.warnings) == 3 * (channels[0]["outcome"] == "limit_reached")


def test_the_stage_gives_the_same_bytes_again(two_runs):
    one, two = ({path: path.read_bytes() for path in files_of(job)} for job in two_runs)
    assert [path.name for path in one] == [path.name for path in two]
    assert len(one) == 8
    for (path, first), second in zip(one.items(), two.values(), strict=True):
        assert first == second, path.name


def files_of(job) -> list[Path]:
    folders = [path for name in ("albedo", "shading") for path in sorted(job.outputs[name].iterdir())]
    return [*folders, job.outputs["lighting"], job.outputs["energy"]]
