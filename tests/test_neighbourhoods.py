"""Means over neighbourhoods: of what is there, at the rim of a mask and at that of the photo."""

from __future__ import annotations

import numpy as np

from stages.photometry.neighbourhoods import means_around
from stages.photometry.stack import stack_views


def test_means_are_of_the_masked_pixels_of_the_square_that_the_photo_has():
    mask = np.array([[1, 1, 1, 1, 0], [1, 1, 0, 1, 1], [1, 1, 1, 1, 1]], bool)
    values = np.random.default_rng(0).random(mask.shape)
    normals = np.tile([0.0, 0, 1], (*mask.shape, 1))
    views = stack_views([mask], [normals], {})
    squares = [np.s_[max(r - 1, 0) : r + 2, max(c - 1, 0) : c + 2] for r, c in np.argwhere(mask)]
    expected = [values[square][mask[square]].mean() for square in squares]
    assert np.allclose(means_around(views, values[mask], 3), expected, rtol=1e-6)
