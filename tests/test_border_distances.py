"""Distances from borders: exact, and the same wherever the array lies in memory."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt, gaussian_filter

from stages.geometry.outlines.border_distances import distances_from_border


def blots(height: int, width: int) -> np.ndarray:
    noise = np.random.default_rng(3).normal(size=(height, width))
    return gaussian_filter(noise, 3) > 0


@pytest.mark.parametrize("shape", [(66, 98), (130, 200), (700, 900)])
def test_distances_are_those_of_an_exact_transform(shape):
    region = blots(*shape)
    np.testing.assert_array_equal(
        distances_from_border(region), distance_transform_edt(region).astype(np.float32)
    )


def test_distances_do_not_depend_on_where_the_array_lies():
    """OpenCV's do, in small images: two of three results below differed in their last digit."""
    region = blots(66, 98)
    expected = distances_from_border(region)
    kept = []
    for size in range(1000, 200_000, 3001):
        kept.append(np.empty(size, np.uint8))  # moves what is allocated next
        np.testing.assert_array_equal(distances_from_border(region), expected)


def test_a_region_without_an_outside_is_far_from_it_everywhere():
    assert (distances_from_border(np.ones((20, 30), bool)) > 1000).all()
    assert (distances_from_border(np.zeros((20, 30), bool)) == 0).all()
