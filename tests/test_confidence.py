"""How well albedo is known: by how many views, in what light, and whether it explains the photo."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from stages.photometry.albedo.confidence import confidence, confidence_of, views_that_see_it
from stages.photometry.albedo.settings import ConfidenceSettings
from stages.photometry.stack import stack_views


def three_views():
    """Of four pixels, four, and one; the first two of the first view fall into one of the second."""
    masks = [np.ones((2, 2), bool), np.ones((2, 2), bool), np.ones((1, 1), bool)]
    normals = [np.broadcast_to([0.0, 0.0, 1.0], (*mask.shape, 3)).astype(np.float32) for mask in masks]
    correspondences = {
        (0, 1): ([0, 1, 2], [0, 0, 3], (4, 4)),
        (0, 2): ([0], [0], (4, 1)),
        (1, 2): ([1], [0], (4, 1)),
    }
    blocks = {
        pair: sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=shape)
        for pair, (rows, columns, shape) in correspondences.items()
    }
    return stack_views(masks, normals, blocks)


def known(**changes) -> np.ndarray:
    views = three_views()
    paint = np.full((9, 3), 0.5, np.float32)
    given = {
        "image": paint,
        "shading": np.ones_like(paint),
        "albedo": paint,
        "incidence": np.ones(9),
        "trusted": np.ones(9, bool),
    }
    return confidence(views, **(given | changes), how=ConfidenceSettings())


def test_a_view_that_is_linked_twice_counts_once():
    assert views_that_see_it(three_views()).tolist() == [2, 1, 1, 0, 1, 1, 0, 1, 2]


def test_more_views_more_light_and_a_better_explanation_are_worth_more():
    plain = known()
    assert plain[0] > plain[1] > plain[3] > 0
    dim = np.where(np.arange(9)[:, None] == 1, 0.1, np.ones((1, 3))).astype(np.float32)
    assert known(shading=dim, albedo=0.5 / dim)[1] < plain[1]
    assert known(albedo=np.full((9, 3), 0.4, np.float32))[1] < plain[1]
    assert known(incidence=np.full(9, 0.5))[1] < plain[1]
    assert not known(trusted=np.zeros(9, bool)).any()


def test_an_expected_error_of_a_tenth_is_half_known():
    variance, trusted = np.array([0.0, 0.01, 1.0, 0.0]), np.array([1, 1, 1, 0], bool)
    known = confidence_of(variance, trusted, ConfidenceSettings())
    assert known == pytest.approx([1, 0.5, 1 / 101, 0])
