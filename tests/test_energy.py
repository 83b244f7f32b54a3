"""The terms of the energy by hand, its gauge and its smoothed twin."""

import numpy as np
import pytest
import scipy.sparse as sp

from stages.photometry.paper.energy import (
    EnergyTerms,
    EnergyWeights,
    consistency_term,
    energy_terms,
    gauge_scale,
    photometric_term,
    smoothed_energy,
    smoothness_term,
)
from stages.photometry.stack import stack_pixels, stack_views, unstack_pixels

WEIGHTS = EnergyWeights(smoothness=0.5, consistency=3.0)
DELTA = 0.5
BALANCED = np.array([np.sqrt(4 * np.pi)] + 8 * [0.0])  # S = 1 for every normal


def two_views():
    """Two views of 2 × 2 and 1 × 2 pixels, normals up, first pixel of one linked to the last of the other."""
    masks = [np.ones((2, 2), bool), np.ones((1, 2), bool)]
    normals = [np.broadcast_to([0.0, 0, 1], (*mask.shape, 3)) for mask in masks]
    correspondences = {(0, 1): sp.csr_array(([1], ([0], [1])), shape=(4, 2))}
    return stack_views(masks, normals, correspondences)


RHO = np.array([1.0, 4.0, 2.0, 2.0, 5.0, 3.0])  # view 1: [[1, 4], [2, 2]]; view 2: [[5, 3]]


def test_eq_3_photometric_term_by_hand():
    """Eq. 3: |1 − 2·1| + |3 − 1·2| + |0 − 0.5·4| + |1 + 0.5·2| = 1 + 1 + 2 + 2; no positivity is imposed."""
    image, albedo, shading = np.array([1.0, 3, 0, 1]), np.array([2.0, 1, 0.5, -0.5]), np.array([1.0, 2, 4, 2])
    assert photometric_term(image, albedo, shading) == 6.0


def test_eq_4_smoothness_term_by_hand():
    """Eq. 4: ∂x: 3 + 0 + 2; ∂y: 1 + 2; nothing across the views."""
    assert smoothness_term(two_views(), RHO) == 8.0


def test_eq_5_consistency_term_by_hand():
    """Eq. 5: |ρ¹(first) − ρ²(last)| = |1 − 3|."""
    assert consistency_term(two_views(), RHO) == 2.0


def test_eq_2_energy_by_hand():
    """Eq. 2: photo + 0.5 smooth + 3 multi-view with S = 1 and I = ρ + 0.25: 6·0.25 + 0.5·8 + 3·2."""
    light = np.stack([BALANCED, BALANCED])
    terms = energy_terms(two_views(), RHO + 0.25, RHO, light)
    assert terms.total(WEIGHTS) == pytest.approx(1.5 + 4.0 + 6.0)
    assert EnergyTerms(1.0, 2.0, 3.0).total(WEIGHTS) == 11.0


def test_the_smoothed_energy_by_hand():
    """h(r) with δ = ½: residuals 6 × ¼ → 5/16 each; one difference is 0 → ¼; the others exceed δ."""
    light = np.stack([BALANCED, BALANCED])
    smoothed = smoothed_energy(two_views(), RHO + 0.25, RHO, light, WEIGHTS, DELTA)
    assert smoothed == pytest.approx(6 * 0.3125 + 0.5 * (8.0 + 0.25) + 3 * 2.0)


def test_the_smoothed_energy_lies_within_half_a_delta_per_term_above_the_energy():
    rng = np.random.default_rng(3)
    views, light = two_views(), rng.standard_normal((2, 9))
    for delta in (1e-4, 1e-2, 1.0):
        weights = EnergyWeights(0.5, 3.0)
        image, albedo = rng.random(6), rng.random(6)
        exact = energy_terms(views, image, albedo, light).total(weights)
        smoothed = smoothed_energy(views, image, albedo, light, weights, delta)
        assert exact <= smoothed <= exact + delta / 2 * (6 + 0.5 * 6 + 3 * 1)


def test_without_a_gauge_the_energy_can_be_shrunk_at_will():
    """(ρ, σ) → (sρ, σ/s): Eq. 3 stays, Eq. 4 and Eq. 5 scale by s: Deviation 1."""
    views, rng = two_views(), np.random.default_rng(1)
    image, albedo, light = rng.random(6), rng.random(6), rng.random((2, 9))
    one = energy_terms(views, image, albedo, light)
    tenth = energy_terms(views, image, albedo / 10, light * 10)
    assert tenth.photo == pytest.approx(one.photo)
    assert tenth.smooth == pytest.approx(one.smooth / 10)
    assert tenth.multi_view == pytest.approx(one.multi_view / 10)


def test_the_gauge_equals_sums_of_absolute_values():
    image, albedo = np.array([1.0, 2.0, 3.0]), np.array([-1.0, 0.5, 1.5])
    assert gauge_scale(image, albedo) == 2.0
    assert gauge_scale(image, np.zeros(3)) == 1.0
    assert gauge_scale(np.zeros(3), albedo) == 1.0


def test_stacking_and_unstacking_are_inverse_inside_the_masks():
    rng = np.random.default_rng(2)
    masks = [rng.random((3, 4)) < 0.5, rng.random((2, 5)) < 0.5]
    images = [rng.random((*mask.shape, 3)).astype(np.float32) for mask in masks]
    back = unstack_pixels(masks, stack_pixels(masks, images))
    for mask, image, again in zip(masks, images, back, strict=True):
        assert np.array_equal(again[mask], image[mask])
        assert not again[~mask].any()


def test_views_and_normals_must_be_as_many():
    mask, normals = np.ones((2, 2), bool), np.tile([0.0, 0, 1], (2, 2, 1))
    with pytest.raises(ValueError, match="zip"):
        stack_views([mask, mask], [normals], {})
