"""Cost of one surface element in one source view: a bilateral ZNCC and a reprojection error.

The element behind pixel p is a plane in inverse depth (`inverse_depth`). Its patch holds the pixels p + Δ
on a regular grid, each weighted by closeness in space and in grey value to p, so that across a depth edge,
or at a silhouette against an even sky, only p's own side speaks. All functions run inside the loops
of `patch_match` and `geometric_consistency`, whose compiled form numba keeps until those files change: after
editing this one, touch them.
"""

from __future__ import annotations

import numpy as np
from numba import njit

F = np.float32
SAMPLES = 32  # fixed, so that compilers unroll and vectorise: a 6 × 6 grid without its corners
OUTSIDE = F(2.0)  # cost of an element that the source does not see: as bad as perfect anti-correlation
DX, DY, WEIGHT, CONTRAST, ACROSS, DOWN, VALUE = range(
    7
)  # rows of a patch's float32 scratch, shape (7, SAMPLES)
ONE = np.uint64(1)


def patch_offsets(radius: int) -> np.ndarray:
    """Place a patch's pixels: offsets (Δx, Δy), (32, 2), float32, reaching `radius` pixels (3 or more).

    Radius 5 takes ±1, ±3, ±5 along either axis, corners left out.
    """
    along = np.rint(radius * np.array([-1, -0.6, -0.2, 0.2, 0.6, 1])).astype(np.float32)
    x, y = np.meshgrid(along, along)
    inner = np.abs(x) + np.abs(y) < 2 * radius
    return np.stack([x[inner], y[inner]], axis=-1)


def spatial_weights(offsets: np.ndarray, sigma: float) -> np.ndarray:
    """Compute Gaussian weights of the offsets, shape (n,), float32; `sigma` in pixels."""
    return np.exp(-np.sum(offsets**2, axis=1) / (2 * sigma**2)).astype(np.float32)


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def weigh_patch(image, y, x, spatial, grey_sigma, patch):
    """Fill p's patch: weights (sum 1) and contrast, weight × (grey − weighted mean); returns the variance.

    Because the contrasts sum to 0, a source's covariance is just Σ contrast · its grey values.
    """
    height, width = image.shape
    grey = image[y, x]
    for k in range(SAMPLES):
        column = min(max(x + np.int32(patch[DX, k]), 0), width - 1)
        row = min(max(y + np.int32(patch[DY, k]), 0), height - 1)
        patch[VALUE, k] = image[row, column]
    total, mean = F(0), F(0)
    for k in range(SAMPLES):
        off = (patch[VALUE, k] - grey) / grey_sigma
        # (1 + off²/4)⁻² instead of exp(−off²/2): the same value and curvature at 0, and no call per sample.
        bell = F(1) / (F(1) + F(0.25) * off * off)
        patch[WEIGHT, k] = spatial[k] * bell * bell
        total += patch[WEIGHT, k]
        mean += patch[WEIGHT, k] * patch[VALUE, k]
    share = F(1) / total
    mean *= share
    variance = F(0)
    for k in range(SAMPLES):
        off = patch[VALUE, k] - mean
        patch[WEIGHT, k] *= share
        patch[CONTRAST, k] = patch[WEIGHT, k] * off
        variance += patch[CONTRAST, k] * off
    return variance


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def photometric_cost(
    flat, start, stride, height, width, p, s, y, x, w, slope_x, slope_y, patch, index, variance, noise
):
    """Compute 1 − ZNCC of p's patch and its image in source s under the plane; OUTSIDE where p falls outside.

    The plane's homography is taken to first order around p. Three loops, coordinates, bilinear gather and
    sums: the first and last vectorise, and few arrays are passed because passing them costs as much as the
    arithmetic.

    Parameters
    ----------
    flat : ndarray, shape (n,), float32
        All sources' grey values; source s starts at `start` with `stride` values per row.
    height, width : int
        Size of source s.
    p : ndarray, shape (S, 3, 4), float32
        `j_from_i` of all sources.
    y, x : int
        The pixel; `w`, `slope_x`, `slope_y` its plane.
    patch : ndarray, shape (7, 32), float32
        What `weigh_patch` filled.
    index : ndarray, shape (32,), int32
        Scratch.
    variance, noise : float32
        Weighted variance of the patch, and the grey-value deviation that is not worth matching.
    """
    q2 = p[s, 2, 0] * F(x) + p[s, 2, 1] * F(y) + p[s, 2, 2] + p[s, 2, 3] * w
    if q2 <= F(1e-6):
        return OUTSIDE
    scale = F(1) / q2
    u = (p[s, 0, 0] * F(x) + p[s, 0, 1] * F(y) + p[s, 0, 2] + p[s, 0, 3] * w) * scale
    v = (p[s, 1, 0] * F(x) + p[s, 1, 1] * F(y) + p[s, 1, 2] + p[s, 1, 3] * w) * scale
    if not (F(0) <= u <= F(width - 1) and F(0) <= v <= F(height - 1)):
        return OUTSIDE
    turn_x, turn_y = p[s, 2, 0] + p[s, 2, 3] * slope_x, p[s, 2, 1] + p[s, 2, 3] * slope_y
    a = (p[s, 0, 0] + p[s, 0, 3] * slope_x - u * turn_x) * scale
    b = (p[s, 0, 1] + p[s, 0, 3] * slope_y - u * turn_y) * scale
    c = (p[s, 1, 0] + p[s, 1, 3] * slope_x - v * turn_x) * scale
    d = (p[s, 1, 1] + p[s, 1, 3] * slope_y - v * turn_y) * scale
    limit_x, limit_y = F(width) - F(1.001), F(height) - F(1.001)
    first, row_length = np.int32(start), np.int32(stride)
    for k in range(SAMPLES):
        at_x = min(max(u + a * patch[DX, k] + b * patch[DY, k], F(0)), limit_x)
        at_y = min(max(v + c * patch[DX, k] + d * patch[DY, k], F(0)), limit_y)
        column, row = np.int32(at_x), np.int32(at_y)
        index[k] = np.int32(first + np.int32(row * row_length) + column)
        patch[ACROSS, k] = at_x - F(column)
        patch[DOWN, k] = at_y - F(row)
    below = np.uint64(stride)
    for k in range(SAMPLES):
        i = np.uint64(index[k])
        top = flat[i] + patch[ACROSS, k] * (flat[i + ONE] - flat[i])
        i += below
        bottom = flat[i] + patch[ACROSS, k] * (flat[i + ONE] - flat[i])
        patch[VALUE, k] = top + patch[DOWN, k] * (bottom - top)
    mean, square, covariance = F(0), F(0), F(0)
    for k in range(SAMPLES):
        weighted = patch[WEIGHT, k] * patch[VALUE, k]
        mean += weighted
        square += weighted * patch[VALUE, k]
        covariance += patch[CONTRAST, k] * patch[VALUE, k]
    other = max(square - mean * mean, F(0))
    floor = noise * noise
    return F(1) - covariance / np.sqrt((variance + floor) * (other + floor))


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def reprojection_error(inverse_depths, height, width, p, back, s, y, x, w, most):
    """Compute the forward-backward error, px of view i, at most `most`: into s, to its own depth, and back.

    Parameters
    ----------
    inverse_depths : ndarray, shape (S, H, W), float32
        The sources' inverse depth; 0 where unknown.
    height, width : int
        Size of source s.
    p, back : ndarray, shape (S, 3, 4), float32
        `j_from_i` and `i_from_j`.
    y, x, w : int, int, float32
        The pixel and its inverse depth.
    most : float32
    """
    q0 = p[s, 0, 0] * F(x) + p[s, 0, 1] * F(y) + p[s, 0, 2] + p[s, 0, 3] * w
    q1 = p[s, 1, 0] * F(x) + p[s, 1, 1] * F(y) + p[s, 1, 2] + p[s, 1, 3] * w
    q2 = p[s, 2, 0] * F(x) + p[s, 2, 1] * F(y) + p[s, 2, 2] + p[s, 2, 3] * w
    if q2 <= F(1e-6):
        return most
    u, v = q0 / q2, q1 / q2
    if not (F(-0.5) <= u < F(width) - F(0.5) and F(-0.5) <= v < F(height) - F(0.5)):
        return most
    other = inverse_depths[s, np.int32(v + F(0.5)), np.int32(u + F(0.5))]
    if other <= F(0):
        return most
    b0 = back[s, 0, 0] * u + back[s, 0, 1] * v + back[s, 0, 2] + back[s, 0, 3] * other
    b1 = back[s, 1, 0] * u + back[s, 1, 1] * v + back[s, 1, 2] + back[s, 1, 3] * other
    b2 = back[s, 2, 0] * u + back[s, 2, 1] * v + back[s, 2, 2] + back[s, 2, 3] * other
    if b2 <= F(1e-6):
        return most
    off_x, off_y = b0 / b2 - F(x), b1 / b2 - F(y)
    return min(np.sqrt(off_x * off_x + off_y * off_y), most)
