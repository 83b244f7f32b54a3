"""The alternation's laws: descent of every half-step, scaling, limits in λ and μ; and it finds the truth."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.sparse as sp

from stages.photometry.energy_history import descent_as_json
from stages.photometry.paper.albedo_step import albedo_step, albedo_system
from stages.photometry.paper.alternation import (
    Descent,
    Outcome,
    State,
    advance,
    alternate,
    decompose_channels,
    start,
)
from stages.photometry.paper.energy import EnergyWeights, energy_terms, smoothed_energy
from stages.photometry.paper.harmonics import shading_basis
from stages.photometry.paper.light_step import light_step
from stages.photometry.paper.settings import PaperSettings
from stages.photometry.stack import StackedViews, stack_views
from stages.solvers.least_squares.correspondence_operator import correspondence_matrix
from stages.solvers.least_squares.difference_operators import difference_matrices
from stages.solvers.least_squares.reweighted_least_squares import l1_weights
from tests.sphere_scene import sphere_scene

WEIGHTS = EnergyWeights(smoothness=2.0, consistency=2.0)
HOW = PaperSettings(
    delta=1e-4, max_alternations=50, energy_tolerance=1e-3, cg_tolerance=1e-6, cg_max_steps=1000
)
NOT_RISING = 1 + 1e-10


def decompose(views: StackedViews, images: list[np.ndarray], how: PaperSettings) -> list[Descent]:
    with ThreadPoolExecutor(2) as executor:
        return decompose_channels(views, images, WEIGHTS, how, executor)


def but(**settings: float) -> PaperSettings:
    """`HOW` with some settings changed."""
    return HOW.model_copy(update=settings)


def si_rmse(estimate: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square error after one least-squares scale."""
    scale = estimate @ truth / (estimate @ estimate)
    return float(np.sqrt(np.mean((scale * estimate - truth) ** 2)))


@pytest.fixture(scope="module")
def small():
    """Three views of some 300 pixels each: (views, first channel of the images)."""
    scene = sphere_scene(3, 24, 20)
    return scene.stacked(), scene.channels()[0]


@pytest.fixture(scope="module")
def somewhere(small):
    """A state away from the start and from the optimum: albedo, light."""
    views, image = small
    rng = np.random.default_rng(4)
    light = np.tile([3.0] + 8 * [0.2], (3, 1)) + 0.3 * rng.standard_normal((3, 9))
    return image * rng.uniform(0.5, 1.5, image.size), light


@pytest.mark.parametrize("delta", [1e-4, 1e-2, 1.0])
def test_eq_9_the_light_step_never_raises_the_smoothed_energy(small, somewhere, delta):
    """Eq. 9 by Eq. 11: repeated, at fixed albedo."""
    (views, image), (albedo, light) = small, somewhere
    energies = [smoothed_energy(views, image, albedo, light, WEIGHTS, delta)]
    for _ in range(6):
        light = light_step(views, image, albedo, light, but(delta=delta))
        energies.append(smoothed_energy(views, image, albedo, light, WEIGHTS, delta))
    assert all(after <= before * NOT_RISING for before, after in zip(energies, energies[1:], strict=False))
    assert energies[1] < energies[0]


@pytest.mark.parametrize("cg_steps", [2, 1000])
@pytest.mark.parametrize("delta", [1e-4, 1e-2, 1.0])
def test_eq_10_the_albedo_step_never_raises_the_smoothed_energy(small, somewhere, delta, cg_steps):
    """Eq. 10 by Eq. 13: repeated, at fixed light; even with conjugate gradients stopped early."""
    (views, image), (albedo, light) = small, somewhere
    how = but(delta=delta, cg_max_steps=cg_steps)
    energies = [smoothed_energy(views, image, albedo, light, WEIGHTS, delta)]
    for _ in range(6):
        albedo = albedo_step(views, image, albedo, light, WEIGHTS, how).x
        energies.append(smoothed_energy(views, image, albedo, light, WEIGHTS, delta))
    assert all(after <= before * NOT_RISING for before, after in zip(energies, energies[1:], strict=False))
    assert energies[1] < energies[0]


def test_eq_11_light_step_by_hand():
    """Eq. 11, Eq. 12: one view, normals up and level, I = ρ S: the light with the least norm that gives S."""
    normals = np.array([[[0.0, 0, 1], [1.0, 0, 0]]])
    views = stack_views([np.ones((1, 2), bool)], [normals], {})
    wanted = np.array([0.9, 0.4])
    albedo = np.array([0.5, 2.0])
    light = light_step(views, albedo * wanted, albedo, np.ones((1, 9)), HOW)
    assert np.allclose(views.shading(light), wanted)
    assert np.allclose(light[0], np.linalg.pinv(shading_basis(normals[0])) @ wanted)


def test_eq_11_weights_make_the_light_robust():
    """Eq. 11 with Eq. 12: highlights on one pixel in fifty hardly move the light in the end."""
    rng = np.random.default_rng(9)
    normals = rng.standard_normal((1, 200, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    views = stack_views([np.ones((1, 200), bool)], [normals], {})
    truth = np.array([[2.0, 0.3, 0.5, -0.2, 0.1, 0, 0.1, 0, 0.2]])
    image = views.shading(truth)
    image[::50] += 5.0
    light = np.ones((1, 9))
    for _ in range(60):
        light = light_step(views, image, np.ones(200), light, HOW)
    assert np.abs(light - truth).max() < 1e-3


def test_eq_13_the_step_minimises_the_weighted_squares(small, somewhere):
    """Eq. 13: the value, written out from the images, is stationary and smallest at the step's result."""
    (views, image), (albedo, light) = small, somewhere
    shading = views.shading(light)
    differences = [
        (WEIGHTS.smoothness, views.d_x),
        (WEIGHTS.smoothness, views.d_y),
        (WEIGHTS.consistency, views.c),
    ]
    w = l1_weights(image - albedo * shading, HOW.delta)
    w_d = [l1_weights(d @ albedo, HOW.delta) for _, d in differences]

    def value(rho: np.ndarray) -> float:
        terms = [
            scale * np.sum(w_e * (d @ rho) ** 2) for (scale, d), w_e in zip(differences, w_d, strict=True)
        ]
        return float(np.sum(w * (image - rho * shading) ** 2) + sum(terms))

    best = albedo_step(views, image, albedo, light, WEIGHTS, but(cg_tolerance=1e-12, cg_max_steps=5000)).x
    rng = np.random.default_rng(0)
    for size in (1e-3, 1e-1):
        for _ in range(5):
            aside = size * rng.standard_normal(best.size)
            assert value(best) < value(best + aside)
            assert value(best + aside) == pytest.approx(value(best - aside), rel=1e-5)


def test_eq_17_the_system_is_the_normal_equations_of_the_printed_blocks(small, somewhere):
    """Eq. 17 from the full operators, empty rows and all."""
    (views, image), (albedo, light) = small, somewhere
    scene = sphere_scene(3, 24, 20)
    counts = [int(mask.sum()) for mask in scene.masks]
    shading = views.shading(light)
    root = np.sqrt(l1_weights(image - albedo * shading, HOW.delta))
    blocks, rows = [sp.diags_array(root * shading)], image.size
    c = correspondence_matrix(scene.correspondences, counts)
    for scale, d in zip((2.0, 2.0, 2.0), (*difference_matrices(scene.masks), c), strict=True):
        blocks.append(sp.diags_array(np.sqrt(scale * l1_weights(d @ albedo, HOW.delta))) @ d)
        rows += d.shape[0]
    j = sp.vstack(blocks).tocsr()
    b = np.zeros(rows)
    b[: image.size] = root * image
    matrix, rhs = albedo_system(views, image, albedo, light, WEIGHTS, HOW.delta)
    assert abs(j.T @ j - matrix).max() < 1e-9 * abs(matrix).max()
    assert np.allclose(j.T @ b, rhs)


def test_the_system_is_an_m_matrix(small, somewhere):
    """A graph Laplacian plus a non-negative diagonal: no positive entry beside the diagonal, rows sum ≥ 0."""
    (views, image), (albedo, light) = small, somewhere
    matrix, _ = albedo_system(views, image, albedo, light, WEIGHTS, HOW.delta)
    beside = matrix - sp.diags_array(matrix.diagonal())
    assert beside.max() <= 0
    assert (matrix.sum(axis=1) >= -1e-9 * matrix.diagonal()).all()


def test_every_alternation_descends_and_ends_in_the_gauge(small):
    views, image = small
    descent = start(views, image, WEIGHTS)
    for _ in range(8):
        previous = descent.state
        descent = advance(views, image, descent, WEIGHTS, HOW)
        record = descent.history[-1]
        assert record.smoothed_after_light <= record.smoothed_before * NOT_RISING
        assert record.smoothed_after_albedo <= record.smoothed_after_light * NOT_RISING
        assert record.smoothed_before == smoothed_energy(
            views, image, previous.albedo, previous.light, WEIGHTS, HOW.delta
        )
        assert np.abs(descent.state.albedo).sum() == pytest.approx(np.abs(image).sum())
        terms = energy_terms(views, image, descent.state.albedo, descent.state.light)
        assert record.energy == terms.total(WEIGHTS)
        ungauged = descent.state.albedo / record.gauge_scale, descent.state.light * record.gauge_scale
        assert record.smoothed_after_albedo == pytest.approx(
            smoothed_energy(views, image, *ungauged, WEIGHTS, HOW.delta)
        )


def test_the_albedo_step_uses_the_new_light(small, somewhere):
    """Deviation 3: ρ^(k+1) comes from σ^(k+1) of the same alternation, as Eq. 17 prints."""
    (views, image), (albedo, light) = small, somewhere
    terms = energy_terms(views, image, albedo, light)
    state, record = alternate(views, image, State(albedo, light, terms), WEIGHTS, HOW)
    new_light = light_step(views, image, albedo, light, HOW)
    new_albedo = albedo_step(views, image, albedo, new_light, WEIGHTS, HOW).x
    assert np.allclose(state.light * record.gauge_scale, new_light)
    assert np.allclose(state.albedo / record.gauge_scale, new_albedo)


def test_scaling_the_images_scales_the_albedo(small):
    """I → s I gives ρ → s ρ and the same light in the fixed gauge, δ being scaled along."""
    views, image = small
    one = start(views, image, WEIGHTS)
    four = start(views, 4 * image, WEIGHTS)
    scaled = but(delta=4 * HOW.delta)
    for _ in range(3):
        one = advance(views, image, one, WEIGHTS, HOW)
        four = advance(views, 4 * image, four, WEIGHTS, scaled)
    assert np.allclose(four.state.albedo, 4 * one.state.albedo, rtol=1e-9)
    assert np.allclose(four.state.light, one.state.light, rtol=1e-9)


def test_renaming_the_views_changes_nothing_but_their_order():
    """With symmetric links (identity), pairs still taken i < j in the new order."""
    scene = sphere_scene(2, 24, 20)
    mask, normals = scene.masks[0], scene.normals[0]
    count = int(mask.sum())
    correspondences = {(0, 1): sp.identity(count, format="csr", dtype=np.uint8)}
    views = stack_views([mask, mask], [normals, normals], correspondences)
    first, second = (scene.images[0][mask][:, 0], 0.8 * scene.images[0][mask][:, 0] ** 1.2)
    there = decompose(views, [np.concatenate([first, second])], but(max_alternations=5))[0]
    back = decompose(views, [np.concatenate([second, first])], but(max_alternations=5))[0]
    assert np.allclose(np.roll(back.state.albedo, count), there.state.albedo, atol=1e-4)
    assert np.allclose(back.state.light[::-1], there.state.light, atol=1e-3)


def test_without_lambda_and_mu_the_albedo_is_image_over_shading(small, somewhere):
    (views, image), (albedo, light) = small, somewhere
    nothing = EnergyWeights(0.0, 0.0)
    shading = views.shading(light)
    found = albedo_step(views, image, albedo, light, nothing, but(cg_tolerance=1e-14, cg_max_steps=2000)).x
    assert np.abs(shading).min() > 0.02
    assert np.allclose(found, image / shading, rtol=1e-6)


def settle(views, image, albedo, light, weights, steps: int = 30) -> np.ndarray:
    """Albedo steps at fixed light, to the end."""
    how = but(cg_tolerance=1e-10, cg_max_steps=5000)
    for _ in range(steps):
        albedo = albedo_step(views, image, albedo, light, weights, how).x
    return albedo


def test_at_fixed_light_a_large_mu_makes_corresponding_pixels_equal(small, somewhere):
    (views, image), (albedo, light) = small, somewhere
    found = settle(views, image, albedo, light, EnergyWeights(0.1, 1e4), 10)
    free = settle(views, image, albedo, light, EnergyWeights(0.1, 0.0), 10)
    assert np.abs(views.c @ found).max() < 1e-3
    assert np.abs(views.c @ free).max() > 0.1


def test_at_fixed_light_a_large_lambda_makes_connected_regions_constant():
    """Two regions of one mask without links: each becomes one value, and not the same."""
    mask = np.ones((6, 9), bool)
    mask[:, 4] = False
    rng = np.random.default_rng(0)
    normals = np.broadcast_to([0.0, 0, 1], (6, 9, 3))
    views = stack_views([mask], [normals], {})
    columns = np.broadcast_to(np.arange(9), (6, 9))[mask]
    image = np.where(columns < 4, 0.3, 0.8) + 0.1 * rng.random(columns.size)
    light = np.array([[np.sqrt(4 * np.pi)] + 8 * [0.0]])
    found = settle(views, image, image.copy(), light, EnergyWeights(1e4, 0.0), steps=60)
    left, right = found[columns < 4], found[columns > 4]
    assert np.ptp(left) < 1e-4
    assert np.ptp(right) < 1e-4
    # The l1 data term is least at a median; with an even count anywhere between the middle two.
    for side, value in ((image[columns < 4], left[0]), (image[columns > 4], right[0])):
        middle = np.sort(side)[[11, 12]]
        assert middle[0] - 1e-3 <= value <= middle[1] + 1e-3


def test_at_fixed_light_a_duplicated_view_leaves_the_albedo_unchanged(somewhere):
    """The same view twice, linked pixel to pixel: the energy doubles, its minimiser stays."""
    scene = sphere_scene(1, 24, 20)
    mask, normals = scene.masks[0], scene.normals[0]
    count = int(mask.sum())
    image = scene.channels()[0]
    light = somewhere[1][:1]
    once = stack_views([mask], [normals], {})
    correspondences = {(0, 1): sp.identity(count, format="csr", dtype=np.uint8)}
    twice = stack_views([mask, mask], [normals, normals], correspondences)
    weights = EnergyWeights(1.0, 2.0)
    alone = settle(once, image, image.copy(), light, weights, steps=8)
    double = np.concatenate([image, image])
    both = settle(twice, double, double.copy(), np.concatenate([light, light]), weights, steps=8)
    assert np.allclose(both[:count], alone, atol=1e-6)
    assert np.allclose(both[count:], alone, atol=1e-6)


def test_outcomes_say_what_happened(small):
    views, image = small
    one = decompose(views, [image], but(max_alternations=1))[0]
    assert one.outcome is Outcome.LIMIT_REACHED
    assert "more alternations" in one.outcome.value
    easy = decompose(views, [image], but(energy_tolerance=0.9))[0]
    assert easy.outcome is Outcome.CONVERGED
    lame = decompose(views, [image], but(energy_tolerance=0.9, cg_max_steps=1))[0]
    assert lame.outcome is Outcome.STALLED
    assert "conjugate-gradient steps" in lame.outcome.value


def test_a_black_channel_is_black_and_done(small):
    views, image = small
    black = decompose(views, [np.zeros_like(image)], HOW)[0]
    assert black.outcome is Outcome.CONVERGED
    assert not black.state.albedo.any()
    assert np.isfinite(black.state.light).all()


def test_the_paper_s_start(small):
    """Section 4: ρ = I, σ = 1."""
    views, image = small
    state = start(views, image, WEIGHTS).state
    assert np.array_equal(state.albedo, image)
    assert np.array_equal(state.light, np.ones((3, 9)))


def test_the_same_bits_every_time_on_any_number_of_workers():
    scene = sphere_scene(2, 24, 20)
    views, images = scene.stacked(), scene.channels()
    few = but(max_alternations=4)
    results = []
    for workers in (1, 3):
        with ThreadPoolExecutor(workers) as executor:
            results.append(decompose_channels(views, images, WEIGHTS, few, executor))
    for one, three in zip(*results, strict=True):
        assert np.array_equal(one.state.albedo, three.state.albedo)
        assert descent_as_json(one) == descent_as_json(three)


def test_steps_leave_their_inputs_alone(small, somewhere):
    (views, image), (albedo, light) = small, somewhere
    before = albedo.copy(), light.copy(), image.copy()
    terms = energy_terms(views, image, albedo, light)
    alternate(views, image, State(albedo, light, terms), WEIGHTS, HOW)
    assert all(np.array_equal(a, b) for a, b in zip(before, (albedo, light, image), strict=True))


def test_the_albedo_beats_the_image_by_a_clear_factor():
    """Four views of a painted sphere under turning light (Eq. 1 holds exactly): si-RMSE per channel."""
    scene = sphere_scene(4, 48, 40)
    descents = decompose(scene.stacked(), scene.channels(), HOW)
    ratios = [
        si_rmse(descent.state.albedo, truth) / si_rmse(image, truth)
        for descent, image, truth in zip(descents, scene.channels(), scene.true_channels(), strict=True)
    ]
    assert max(ratios) < 0.6
    assert np.mean(ratios) < 0.45
