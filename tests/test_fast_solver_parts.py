"""What `solver: fast` is made of: graph and pyramid keep the energy of Eq. 2, steps find known optima."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.photometry.joint.coarse_to_fine import steps_of
from stages.photometry.joint.problem_assembly import EdgeWeights, graph_of, problem_of
from stages.photometry.joint.pyramid import Level, coarser, pyramid
from stages.photometry.joint.settings import FastSettings
from stages.photometry.paper.energy import EnergyWeights
from stages.photometry.stack import StackedViews, stack_views
from stages.solvers.kernels.sliced_ellpack import BLOCK, Slices
from stages.solvers.kernels.threading_layer import use_threads
from stages.solvers.primal_dual.gram_matrices import gram_matrices
from stages.solvers.primal_dual.graph import PrimalDual
from stages.solvers.primal_dual.half_edges import aggregated, from_edges
from stages.solvers.primal_dual.problem import Steps
from stages.solvers.primal_dual.sliced_graph import WINDOW, sliced_graph, slices_of
from tests.fixed_light import STEPS, albedo_of, fixed_light
from tests.linked_graphs import exact_energy, random_views, variation
from tests.sphere_scene import sphere_scene

SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(deadline=None, max_examples=20, derandomize=True)
WEIGHTS = EnergyWeights(smoothness=2.0, consistency=1.5)
ONE_THREAD = 1


# The graph


@given(SEEDS)
@FEW
def test_the_graph_has_the_variation_of_the_operators(seed):
    """λ times Eq. 4 plus μ times Eq. 5."""
    rng = np.random.default_rng(seed)
    views = random_views(rng)
    albedo = 3 + rng.standard_normal(int(views.starts[-1]))
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
    basis = views.basis.astype(np.float32).reshape(*views.basis.shape[:2], -1)
    return Level(
        views.starts,
        views.positions(),
        basis,
        image.astype(np.float32),
        np.ones(len(image), np.float32),
        graph_of(views, WEIGHTS),
        np.zeros(views.view_count, np.int64),
    )


@given(SEEDS)
@FEW
def test_a_coarser_level_is_the_same_problem_on_groups(seed):
    """Views stay apart, positions halve; a ρ of the groups has a quarter of Eq. 2's signed residuals."""
    rng = np.random.default_rng(seed)
    views = random_views(rng)
    fine = level_of(views, rng.random((int(views.starts[-1]), 3)))
    coarse = coarser(fine)
    group = coarse.group
    assert np.array_equal(coarse.view_of_pixel[group], fine.view_of_pixel)
    assert np.array_equal(coarse.positions[group], fine.positions // 2)
    places = np.column_stack([coarse.view_of_pixel, coarse.positions])
    assert len(np.unique(places, axis=0)) == len(places)
    assert len(np.unique(group)) == len(places)

    light, albedo = rng.standard_normal((3, 9)), rng.random(len(places))
    residual_of = [
        level.image[:, 0] - rho * np.einsum("pk,pk->p", level.basis[:, :, 0], light[level.view_of_pixel])
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
    assert np.allclose(coarse.basis[:, :, 0], views.basis[0])
    assert coarse.graph.neighbour[:3].tolist() == [1, 2, 4]
    assert coarse.graph.weight[:3].tolist() == [WEIGHTS.smoothness / 2] * 2 + [WEIGHTS.consistency]


def test_the_pyramid_goes_from_coarse_to_the_given_level_and_stops_in_time():
    views = sphere_scene(3, 24, 20).stacked()
    finest = level_of(views, np.ones((int(views.starts[-1]), 3)))
    levels = pyramid(finest, 10)
    assert levels[-1] is finest
    assert len(levels) > 2
    for coarse, fine in zip(levels, levels[1:], strict=False):
        assert coarse.group.shape == (fine.image.shape[0],)
        assert coarse.image.shape[0] == coarse.group.max() + 1 < fine.image.shape[0]
    assert levels[0].image.shape[0] >= 30
    assert pyramid(finest, 10**6) == [finest]


# The albedo step


def random_shading(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Of either sign, some of it exactly 0."""
    size = rng.uniform(0.3, 1.5, shape) * rng.choice([0.0, 1.0], shape, p=[0.15, 0.85])
    return (size * rng.choice([-1.0, 1.0], shape, p=[0.2, 0.8])).astype(np.float32)


# Duals of 16 bits then resolve 1e-6, and the second half of the iterations is not drawn back.
DEFAULT = steps_of(FastSettings(), known_light=False)
FINE = replace(STEPS, scale=0.01, epoch=3000)


def solved(graph, image, shading, count=6000, steps=STEPS) -> np.ndarray:
    use_threads(ONE_THREAD)
    solver = fixed_light(graph, image, shading, steps)
    solver.iterate(count)
    return albedo_of(solver)


@given(SEEDS, st.sampled_from([0.05, 0.3, 2.0]), st.sampled_from([0.0, 0.3, 2.0]))
@FEW
def test_eq_10_at_fixed_light_the_optimum_is_that_of_a_linear_program(seed, smoothness, consistency):
    """Eq. 10 to 0.1 %, on grids linked across views, S of both signs and 0."""
    rng = np.random.default_rng(seed)
    views = random_views(rng, side=4)
    graph = graph_of(views, EnergyWeights(smoothness, consistency))
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
    graph = graph_of(random_views(rng), EnergyWeights(0.0, 0.0))
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
    heavy, light = (from_edges(2, np.array([0]), np.array([1]), np.array([w])) for w in (5.0, 0.3))
    assert np.allclose(solved(heavy, image, shading, steps=FINE), 0.2, atol=1e-6)
    assert np.allclose(solved(light, image, shading, steps=FINE)[:, 0], [0.2, 0.8], atol=1e-6)


# Slices, and the graph in them


@given(SEEDS)
@FEW
def test_slices_give_back_what_was_spread_and_hold_nothing_else(seed):
    rng = np.random.default_rng(seed)
    slices = Slices.of(np.concatenate([[0], np.cumsum(rng.integers(0, 30, size=4))]))
    values = rng.uniform(1, 2, (slices.starts[-1], 3)).astype(np.float32)
    spread = slices.spread(values)
    assert spread.shape == (slices.count, 3, 8)
    assert np.array_equal(slices.collect(spread), values)
    assert np.count_nonzero(spread) == values.size
    for view in range(4):
        own = spread[slices.first[view] : slices.first[view + 1], 0].ravel()
        assert np.array_equal(own[own > 0], values[slices.starts[view] : slices.starts[view + 1], 0])


def test_blocks_cover_every_slice_once_and_no_block_two_views():
    slices = Slices.of(np.array([0, 5, 5, 5 + 8 * BLOCK + 1, 5 + 8 * BLOCK + 30]))
    blocks = slices.blocks
    covered = [s for b, e in zip(blocks.begin, blocks.end, strict=True) for s in range(b, e)]
    assert covered == list(range(slices.count))
    assert blocks.view.tolist() == [0, 2, 2, 3]
    counts = blocks.by_view((blocks.end - blocks.begin)[:, None].astype(float))
    assert counts.ravel().tolist() == np.diff(slices.first).tolist()


@given(SEEDS)
@FEW
def test_rows_of_eight_hold_every_half_edge_once(seed):
    """Read back from the rows, the graph is the graph; what fills a row up weighs nothing."""
    rng = np.random.default_rng(seed)
    views = random_views(rng)
    graph = graph_of(views, WEIGHTS)
    slices = slices_of(graph, views.starts)
    rows = sliced_graph(graph, slices)
    pixel_at = np.full(8 * slices.count, -1)
    pixel_at[slices.places] = np.arange(graph.size)
    found = np.zeros((graph.size, graph.size), np.float32)
    for s in range(slices.count):
        for at in range(8 * int(rows.first[s]), 8 * int(rows.first[s + 1])):
            if rows.weight[at]:
                own, other = 8 * s + at % 8, rows.neighbour[at]
                found[pixel_at[own], pixel_at[other]] += rows.weight[at]
    expected = sp.csr_array((graph.weight, graph.neighbour, graph.first), shape=found.shape).toarray()
    assert np.array_equal(found, expected)
    assert np.allclose(rows.total[slices.places], np.maximum(expected.sum(axis=1), 1e-6), rtol=1e-6)


def test_pixels_of_a_slice_have_about_as_many_neighbours_each():
    """A star of every size: without sorting, rows would be mostly filling."""
    rng = np.random.default_rng(3)
    tail, head = rng.integers(0, 1500, (2, 9000))
    graph = from_edges(1500, tail, np.where(head == tail, (tail + 1) % 1500, head), np.ones(9000))
    slices = slices_of(graph, np.array([0, 700, 1500]))
    filling = 4  # lanes that the first view's last slice leaves empty
    for begin, end, shift in ((0, 700, 0), (700, 1500, filling)):
        places = slices.places[begin:end] - shift
        assert sorted(places) == list(range(begin, end))
        assert np.abs(places - np.arange(begin, end)).max() < WINDOW
    sorted_rows = sliced_graph(graph, slices).weight.size
    assert sorted_rows < 1.2 * graph.weight.size < sliced_graph(graph, Slices.of(slices.starts)).weight.size


# Albedo and light together


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
    image, albedo = rng.uniform(0.1, 1, (2, int(views.starts[-1]), 3)).astype(np.float32)
    albedo *= rng.choice(np.float32([-1, 0, 1]), albedo.shape, p=[0.1, 0.1, 0.8])
    light = np.tile([2.0] + 8 * [0.2], (3, 3, 1)) + 0.2 * rng.standard_normal((3, 3, 9))
    return views, image, albedo, light


def descent(unlinked, steps: Steps = DEFAULT) -> PrimalDual:
    views, image, albedo, light = unlinked
    problem = problem_of(level_of(views, image))
    return PrimalDual(problem, problem.slices.spread(albedo), light, steps)


@pytest.fixture(scope="module", params=["shared by the channels", "of each channel"])
def lit(request, unlinked):
    """The same with a basis of either kind."""
    views, *rest = unlinked
    if request.param == "of each channel":
        tints = np.random.default_rng(1).uniform(0.5, 1.5, (*views.basis.shape, 3)).astype(np.float32)
        views = replace(views, basis=(views.basis[:, :, None] * tints).astype(np.float32).astype(np.float64))
    return views, *rest


def test_eq_1_compiled_shading_is_light_times_basis(lit):
    """S = σ·ν of Eq. 1."""
    views, _, _, light = lit
    solver = descent(lit)
    found = solver.problem.slices.collect(solver.shading())
    for c in range(3):
        assert np.allclose(found[:, c], views.of_channel(c).shading(light[:, c]), atol=1e-5)


def test_gram_matrices_are_sums_of_products_of_the_basis(lit):
    """Σ ρ² ν νᵀ per view and channel; 0 for the empty view."""
    views, _, albedo, _ = lit
    solver = descent(lit)
    found = gram_matrices(solver.problem.slices.blocks, solver.problem.basis, solver.albedo)
    for view in range(3):
        for c in range(3):
            own = views.view(view)
            basis, rho = views.of_channel(c).basis[own], albedo[own, c].astype(float)
            expected = np.einsum("p,pk,pl->kl", rho**2, basis, basis)
            assert np.allclose(found[view, c], expected, rtol=1e-9, atol=1e-9)


def test_a_basis_that_is_the_same_in_each_channel_gives_the_same_bits_as_a_shared_one(unlinked):
    views, *rest = unlinked
    repeated = replace(views, basis=np.repeat(views.basis[:, :, None], 3, axis=2))
    found = []
    for one in (views, repeated):
        solver = descent((one, *rest))
        solver.iterate(25)
        found.append(solver)
    assert found[0].problem.basis.shape[2] == 1 and found[1].problem.basis.shape[2] == 3
    assert np.array_equal(found[0].albedo, found[1].albedo)
    assert np.array_equal(found[0].light, found[1].light)


def test_iterations_keep_the_gauge_and_give_the_same_bits_on_one_thread_and_on_two(unlinked):
    found = []
    for threads in (1, 2):
        use_threads(threads)
        solver = descent(unlinked)
        solver.iterate(40)
        found.append((solver.albedo, solver.light))
        weighed = np.abs(solver.albedo).sum(axis=(0, 2), dtype=float)
        assert np.allclose(weighed, solver.problem.wanted, rtol=1e-5)
    assert np.array_equal(found[0][0], found[1][0])
    assert np.array_equal(found[0][1], found[1][1])
    assert not np.array_equal(found[0][1], unlinked[3])


def test_a_light_that_is_held_stays(unlinked):
    views, image, albedo, light = unlinked
    problem = problem_of(level_of(views, image))
    solver = PrimalDual(problem, problem.slices.spread(albedo), light, DEFAULT, free_light=False)
    solver.iterate(20)
    assert np.array_equal(solver.light, light)


def test_a_black_channel_and_an_empty_view_have_finite_light(unlinked):
    views, image, albedo, light = unlinked
    image, albedo = image * np.float32([1, 0, 1]), albedo * np.float32([1, 1, 0])
    solver = descent((views, image, albedo, light))
    solver.iterate(60)
    assert np.isfinite(solver.light).all()
    assert np.isfinite(solver.albedo).all()


def test_a_finer_level_inherits_the_duals_of_its_groups():
    """What pulls at a group is a quarter of what pulls at its pixels together."""
    views = sphere_scene(3, 24, 20).stacked()
    rng = np.random.default_rng(4)
    fine = level_of(views, rng.uniform(0.2, 1, (int(views.starts[-1]), 3)))
    coarse = coarser(fine)
    light = np.zeros((3, 3, 9))
    light[:, :, 0] = 3.5
    one = _held(coarse, coarse.image / coarse.share[:, None], light)
    one.iterate(100)
    pull = _pulls(one)
    two = PrimalDual.from_coarse(one.coarse_state(), problem_of(fine), coarse.group)
    assert np.array_equal(albedo_of(two), albedo_of(one)[coarse.group])
    assert np.array_equal(two.light, one.light)
    sums = np.stack([np.bincount(coarse.group, each) for each in _pulls(two).T], axis=1)
    assert np.abs(pull).max() > 0.1
    assert np.allclose(sums / 4, pull, atol=1e-3)


def test_a_finer_level_pulls_no_group_apart():
    """Where no edge within a group is at its bound, what pulls at its pixels goes by the weights of these."""
    views = sphere_scene(3, 24, 20).stacked()
    fine = level_of(views, np.random.default_rng(5).uniform(0.2, 1, (int(views.starts[-1]), 3)))
    coarse = coarser(fine)
    light = np.full((3, 3, 9), 0.3)
    light[:, :, 0] = 3.5
    problem = problem_of(coarse)
    one = PrimalDual(problem, problem.slices.spread(coarse.image / coarse.share[:, None]), light, DEFAULT)
    one.iterate(30)
    two = PrimalDual.from_coarse(one.coarse_state(), problem_of(fine), coarse.group)
    two.fill_in(coarse.group)
    slices = two.problem.slices
    within, bound = _edges_within(fine, coarse.group, two)
    shading, multiplier = slices.collect(two.shading()), two.coarse_state().multiplier
    held = np.minimum(multiplier[fine.gauge_of_view[fine.view_of_pixel]], np.abs(shading))
    force = _pulls(two) + shading * slices.collect(two.coarse_state().data_dual) - held
    assert held.min() > 5e-3  # what is asked of the rest is finer
    groups = coarse.image.shape[0]
    easy = np.bincount(coarse.group, bound, groups)[coarse.group] == 0
    total = np.bincount(coarse.group, within, groups)[coarse.group]
    assert np.mean(easy) > 0.5
    for channel in force.T:
        shared = within / np.maximum(total, 1) * np.bincount(coarse.group, channel, groups)[coarse.group]
        assert np.abs(shared)[easy].max() > 0.05
        assert np.allclose(channel[easy & (within > 0)], shared[easy & (within > 0)], atol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_filling_in_leaves_duals_that_are_opposite_at_both_ends(seed):
    """Under a light that moves, in the gauge, with edges of any weight, next to nothing included."""
    views = sphere_scene(3, 24, 20).stacked()
    rng = np.random.default_rng(seed)
    fine = level_of(views, rng.uniform(0.2, 1, (int(views.starts[-1]), 3)))
    count = sum(p.size for p, _ in views.neighbours())
    uneven = EdgeWeights(smoothness=10.0 ** rng.uniform(-9, 1, count).astype(np.float32))
    fine = replace(fine, graph=graph_of(views, WEIGHTS, uneven))
    coarse = coarser(fine)
    light = np.full((3, 3, 9), 0.3)
    problem = problem_of(coarse)
    one = PrimalDual(problem, problem.slices.spread(coarse.image / coarse.share[:, None]), light, DEFAULT)
    one.iterate(40)
    two = PrimalDual.from_coarse(one.coarse_state(), problem_of(fine), coarse.group)
    before = two.edge_dual.copy()
    two.fill_in(coarse.group)
    assert np.any(two.edge_dual != before)
    assert np.all(np.abs(two.edge_dual.astype(int)) <= np.maximum(16383, np.abs(before.astype(int))))
    ends = _duals_of_ends(two)
    assert all(np.array_equal(dual, -ends[q, p]) for (p, q), dual in ends.items())


def _duals_of_ends(solver: PrimalDual) -> dict[tuple[int, int], np.ndarray]:
    """Duals of the three channels by the two places of an edge, its own first."""
    graph, dual = solver.problem.graph, solver.edge_dual.reshape(-1, 3, 8).astype(int)
    own, held = _own_places(solver), np.flatnonzero(graph.weight > 0)
    return {(int(own[at]), int(graph.neighbour[at])): dual[at // 8, :, at % 8] for at in held}


def _edges_within(level: Level, group: np.ndarray, solver: PrimalDual) -> tuple[np.ndarray, np.ndarray]:
    """Every pixel's weight within its group, and how many such edges are at their bound, (N,) each."""
    graph, slices = solver.problem.graph, solver.problem.slices
    own, groups = _own_places(solver), slices.spread_numbers(group)
    inside = (graph.weight > 0) & (groups[own] == groups[graph.neighbour])
    clipped = (np.abs(solver.edge_dual.reshape(-1, 3, 8)) >= 16383).any(axis=1).ravel()
    weight = np.bincount(own, graph.weight * inside, 8 * slices.count)
    bound = np.bincount(own, clipped & inside, 8 * slices.count)
    return weight[slices.places], bound[slices.places]


def _own_places(solver: PrimalDual) -> np.ndarray:
    """The place that every half-edge belongs to, (R · 8,)."""
    return (8 * _own_slices(solver)[:, None] + np.arange(8)).ravel()


def _own_slices(solver: PrimalDual) -> np.ndarray:
    """The slice that every row belongs to, (R,)."""
    rows = np.diff(solver.problem.graph.first.astype(np.int64))
    return np.repeat(np.arange(solver.problem.slices.count), rows)


def _held(level: Level, albedo: np.ndarray, light: np.ndarray) -> PrimalDual:
    problem = problem_of(level)
    return PrimalDual(problem, problem.slices.spread(albedo), light, DEFAULT, free_light=False)


def _pulls(solver: PrimalDual) -> np.ndarray:
    """Kᵀy of every pixel, (N, 3)."""
    graph, slices = solver.problem.graph, solver.problem.slices
    dual = solver.edge_dual.reshape(-1, 3, 8) / 16383
    weighed = dual * graph.weight.reshape(-1, 1, 8)
    pulls = np.zeros((slices.count, 3, 8))
    np.add.at(pulls, _own_slices(solver), weighed)
    return slices.collect(pulls)
