"""Geometric consistency of a depth map with those of other views."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

import stages.solvers.kernels.threading_layer  # noqa: F401 -- chooses the threads below
from stages.stereo.depth.patch_cost import reprojection_error
from stages.stereo.depth.patch_match import Sources

F = np.float32


@njit(cache=True, nogil=True, parallel=True)
def _count(inverse, sizes, projections, back, inverse_depths, most_px):
    height, width = inverse.shape
    count = np.zeros((height, width), np.uint8)
    beyond = F(2) * most_px + F(1)  # where an error is cut off: above the bound, so without effect
    for y in prange(height):
        for x in range(width):
            w = inverse[y, x]
            if w <= F(0):
                continue
            for s in range(sizes.shape[0]):
                error = reprojection_error(
                    inverse_depths, sizes[s, 0], sizes[s, 1], projections, back, s, y, x, w, beyond
                )
                if error <= most_px:
                    count[y, x] += 1
    return count


def consistent_views(inverse: np.ndarray, sources: Sources, most_px: float) -> np.ndarray:
    """Count the sources that confirm each pixel, shape (h, w), uint8.

    A source confirms a pixel when going there, taking the source's own depth and coming back ends within
    `most_px` of where it began. Pixels of unknown depth (0) count 0.

    Parameters
    ----------
    inverse : ndarray, shape (h, w), float32
        Inverse depth.
    sources : Sources
        With their inverse depths.
    most_px : float
        Pixels of the view.
    """
    return _count(
        inverse, sources.sizes, sources.projections, sources.back, sources.inverse_depths, F(most_px)
    )


def confirmed(
    inverse: np.ndarray, costs: np.ndarray, count: np.ndarray, *, highest_cost: float, fewest: int
) -> np.ndarray:
    """Mask the pixels to keep, (h, w), bool: cost at most `highest_cost`, and `fewest` sources agree.

    Parameters
    ----------
    inverse, costs, count : ndarray, shape (h, w)
        Inverse depth, what `patch_match.refine` charged, and `consistent_views`.
    highest_cost : float
        A flat background costs 1: it correlates with nothing.
    fewest : int
    """
    return (inverse > 0) & (costs <= highest_cost) & (count >= fewest)
