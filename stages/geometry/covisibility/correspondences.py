"""Correspondences of pixels between two views, by depth alone."""

from __future__ import annotations

from math import floor

import numpy as np
import scipy.sparse as sp
from numba import njit

from stages.scene.cameras import Camera, back_project, footprint, project


def find_correspondences(
    camera_i: Camera,
    depth_i: np.ndarray,
    mask_i: np.ndarray,
    camera_j: Camera,
    depth_j: np.ndarray,
    mask_j: np.ndarray,
    *,
    epsilon: float,
) -> sp.csr_array:
    """Find the correspondences C_ij of two views, at most one 1 per row: what Eq. 5 sums over.

    Eq. 6: ``C_ij(p^i, p^j) = 1`` if p^i and p^j correspond to the same surface point, 0 otherwise; decided by

    Eq. 8: ``‖π_i⁻¹(p^i) − π_j⁻¹(p^j)‖ ≤ ε``, for the p^j that is nearest in space.

    Parameters
    ----------
    camera_i, camera_j : Camera
    depth_i, depth_j : ndarray, shape (height, width)
        z in each camera, model units.
    mask_i, mask_j : ndarray, shape (height, width), bool
        Ω^i, Ω^j. A pixel without positive depth corresponds to nothing.
    epsilon : float
        ε in pixel footprints.

    Returns
    -------
    csr_array, shape (|Ω^i|, |Ω^j|), uint8
        Rows and columns are the masks' pixels, row by row.

    Notes
    -----
    Eq. 8 alone accepts every p^j within ε; Section 4 wants at most one per row. The candidates are the 3 × 3
    pixels around the projection of the point behind p^i; the one whose own point is nearest in space wins,
    the first in row order among equals. On a slanted surface that need not be the pixel that the
    projection falls into.

    Deviation 4: ε counts pixel footprints, z/f (the larger of the two pixels'), where the paper's ε = 3 has
    no unit: a fixed length would mean another thing at every distance and in every model's scale.
    """
    points = np.where((depth_i > 0)[..., None], back_project(camera_i, depth_i), np.nan)[mask_i]
    sizes = np.asarray(footprint(camera_i, depth_i[mask_i]), np.float64)
    partner = pixels_showing(points, sizes, camera_j, depth_j, mask_j, epsilon)
    return _one_per_row(partner, int(np.count_nonzero(mask_j)))


def pixels_showing(
    points: np.ndarray,
    footprints: np.ndarray,
    camera: Camera,
    depth: np.ndarray,
    mask: np.ndarray,
    epsilon: float,
) -> np.ndarray:
    """Find the pixel of a view that shows each surface point, by Eq. 8.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        World axes, model units; NaN for none.
    footprints : ndarray, shape (n,)
        Model units, in the view that each point comes from.
    camera : Camera
    depth, mask : ndarray, shape (height, width)
        z, model units, and Ω of the view.
    epsilon : float
        ε in pixel footprints.

    Returns
    -------
    ndarray, shape (n,), int64
        Index among the mask's pixels, row by row; −1 where the view does not show the point.
    """
    xy, z = project(camera, points)
    return _nearest_points(
        points,
        np.where((z > 0)[:, None], xy, -np.inf),
        footprints,
        back_project(camera, depth),
        np.asarray(footprint(camera, depth), np.float64),
        _numbers(mask & (depth > 0), mask),
        float(epsilon),
    )


def _numbers(usable: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Index of every usable pixel among the mask's pixels, row by row; −1 elsewhere."""
    numbers = np.full(mask.shape, -1, np.int64)
    numbers[mask] = np.arange(np.count_nonzero(mask))
    return np.where(usable, numbers, -1)


@njit(cache=True, nogil=True)
def _nearest_points(points_i, xy, footprint_i, points_j, footprint_j, number_j, epsilon):
    """For every point, the index of its partner in j's mask, or −1; linear in the number of points.

    `points_i` (P, 3), `xy` (P, 2) their image coordinates in j, `footprint_i` (P,); `points_j` (h, w, 3),
    `footprint_j` and `number_j` (h, w).
    """
    height, width = number_j.shape
    partner = np.full(points_i.shape[0], -1, np.int64)
    for p in range(points_i.shape[0]):
        if not (-1 <= xy[p, 0] < width + 1 and -1 <= xy[p, 1] < height + 1):
            continue
        column, row = floor(xy[p, 0]), floor(xy[p, 1])
        nearest, limit = np.inf, 0.0
        for r in range(max(row - 1, 0), min(row + 2, height)):
            for c in range(max(column - 1, 0), min(column + 2, width)):
                if number_j[r, c] < 0:
                    continue
                distance = np.sqrt(np.sum((points_i[p] - points_j[r, c]) ** 2))
                if distance < nearest:
                    nearest = distance
                    limit = epsilon * max(footprint_i[p], footprint_j[r, c])
                    partner[p] = number_j[r, c]
        if nearest > limit:
            partner[p] = -1
    return partner


def _one_per_row(partner: np.ndarray, columns: int) -> sp.csr_array:
    """Sparse matrix with a 1 at (p, partner[p]) where partner[p] ≥ 0."""
    linked = partner >= 0
    indptr = np.concatenate([[0], np.cumsum(linked)]).astype(np.int32)
    indices = partner[linked].astype(np.int32)
    ones = np.ones(indices.size, np.uint8)
    return sp.csr_array((ones, indices, indptr), shape=(partner.size, columns))
