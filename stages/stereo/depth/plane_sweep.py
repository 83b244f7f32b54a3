"""Plane sweep: matching costs of every pixel on each of a family of fronto-parallel planes.

For one view i and inverse depths w_0 < … < w_(D−1), each source j is warped onto i by the plane's
homography (the projection `inverse_depth.j_from_i` at constant w) and compared by zero-mean normalised
cross-correlation (ZNCC) over a small window. A pixel's cost on a plane is 1 − the mean of its k best ZNCCs:
sources in which it is hidden are simply not among the best.

Memory: one byte per pixel and plane, twice, plus about (5 + S) bytes per pixel and thread for S sources.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

import stages.solvers.kernels.threading_layer  # noqa: F401 -- chooses the threads below
from stages.stereo.mvs_settings import MvsSettings, PlaneSweepSettings

F = np.float32
INVALID = np.uint8(255)  # a score: the pixel falls outside of the source
WORST = np.uint8(254)  # a cost: no correlation


def pixels_per_inverse_depth(
    projections: np.ndarray, shape: tuple[int, int], inverse: float, places: int
) -> np.ndarray:
    """Compute how fast each source's image of a pixel moves with inverse depth, (S,), px × depth: the median.

    Parameters
    ----------
    projections : ndarray, shape (S, 3, 4)
        `j_from_i` of each source.
    shape : tuple of int
        (height, width) of view i, pixels.
    inverse : float
        Inverse depth at which the speed is taken.
    places : int
        Across the image and down it.
    """
    across, down = (np.linspace(0, side - 1, places) for side in (shape[1], shape[0]))
    x, y = (axis.ravel() for axis in np.meshgrid(across, down))
    q = projections @ np.stack([x, y, np.ones_like(x), np.full_like(x, inverse)])
    e = projections[:, :, 3:]
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = (e[:, :2] * q[:, 2:] - q[:, :2] * e[:, 2:]) / q[:, 2:] ** 2
    return np.median(np.where(q[:, 2] > 0, np.hypot(speed[:, 0], speed[:, 1]), 0.0), axis=1)


def disparity_speed(
    projections: np.ndarray, shape: tuple[int, int], inverse: float, how: PlaneSweepSettings
) -> float:
    """Compute the disparity of the source at the `parallax_quantile` of speeds, px per inverse depth."""
    speeds = pixels_per_inverse_depth(projections, shape, inverse, how.speed_places)
    return float(np.quantile(speeds, how.parallax_quantile))


def inverse_depth_planes(
    projections: np.ndarray, shape: tuple[int, int], near: float, far: float, settings: MvsSettings
) -> np.ndarray:
    """Space inverse depths evenly from 1/far to 1/near, by about `sweep_step_px` of disparity.

    The disparity is `disparity_speed` at the middle of the range; at least `fewest_planes`, never more than
    `sweep_planes`.

    Returns
    -------
    ndarray, shape (D,), float32
        Ascending.
    """
    first, last = 1.0 / far, 1.0 / near
    speed = disparity_speed(projections, shape, (first + last) / 2, settings.sweep)
    count = int(np.ceil((last - first) * speed / settings.sweep_step_px)) + 1
    most = int(np.clip(count, settings.sweep.fewest_planes, settings.sweep_planes))
    return np.linspace(first, last, most).astype(np.float32)


@njit(cache=True, nogil=True, fastmath=True)
def _warp(source, height, width, p, inverse, warped, inside):
    """Sample `source` where view i's pixels fall on the plane 1/z = inverse; mark what is inside."""
    limit_x, limit_y = F(width - 1), F(height - 1)
    columns = warped.shape[1]
    u = np.empty(columns, np.float32)
    v = np.empty(columns, np.float32)
    for y in range(warped.shape[0]):
        a = p[0, 1] * F(y) + p[0, 2] + p[0, 3] * inverse
        b = p[1, 1] * F(y) + p[1, 2] + p[1, 3] * inverse
        c = p[2, 1] * F(y) + p[2, 2] + p[2, 3] * inverse
        for x in range(columns):
            z = p[2, 0] * F(x) + c
            reciprocal = F(1) / max(z, F(1e-6))
            u_x = (p[0, 0] * F(x) + a) * reciprocal
            v_x = (p[1, 0] * F(x) + b) * reciprocal
            good = (z > F(1e-6)) & (u_x >= F(0)) & (u_x <= limit_x) & (v_x >= F(0)) & (v_x <= limit_y)
            inside[y, x] = good
            u[x] = min(max(u_x, F(0)), limit_x)
            v[x] = min(max(v_x, F(0)), limit_y)
        for x in range(columns):
            column = min(np.int32(u[x]), width - 2)
            row = min(np.int32(v[x]), height - 2)
            fx, fy = u[x] - F(column), v[x] - F(row)
            top = source[row, column] + fx * (source[row, column + 1] - source[row, column])
            bottom = source[row + 1, column] + fx * (source[row + 1, column + 1] - source[row + 1, column])
            warped[y, x] = top + fy * (bottom - top)


@njit(cache=True, nogil=True, fastmath=True)
def _window_sums(columns, radius, sums):
    """Horizontal window sums of a row whose ends are padded by `radius`."""
    width = sums.size
    sums[:] = columns[:width]
    for k in range(1, 2 * radius + 1):
        for x in range(width):
            sums[x] += columns[x + k]


@njit(cache=True, nogil=True, fastmath=True)
def _column_sums(a, b, y, radius, columns):
    """Sums of a·b over the rows of the window around row y (rows replicated at the border), ends padded."""
    height, width = a.shape
    columns[:] = F(0)
    inner = columns[radius : radius + width]
    for dy in range(-radius, radius + 1):
        row = min(max(y + dy, 0), height - 1)
        a_row, b_row = a[row], b[row]
        for x in range(width):
            inner[x] += a_row[x] * b_row[x]
    columns[:radius] = inner[0]
    columns[radius + width :] = inner[width - 1]


@njit(cache=True, nogil=True, fastmath=True)
def window_statistics(image, ones, radius, noise):
    """Compute window mean and 1 / sqrt(variance + noise²), both (h, w) float32; borders replicated."""
    height, width = image.shape
    mean = np.empty((height, width), np.float32)
    scale = np.empty((height, width), np.float32)
    columns = np.empty(width + 2 * radius, np.float32)
    sums = np.empty(width, np.float32)
    squares = np.empty(width, np.float32)
    inverse_area = F(1) / F((2 * radius + 1) ** 2)
    floor = F(noise * noise)
    for y in range(height):
        _column_sums(image, ones, y, radius, columns)
        _window_sums(columns, radius, sums)
        _column_sums(image, image, y, radius, columns)
        _window_sums(columns, radius, squares)
        mean_row, scale_row = mean[y], scale[y]
        for x in range(width):
            centre = sums[x] * inverse_area
            variance = max(squares[x] * inverse_area - centre * centre, F(0))
            mean_row[x] = centre
            scale_row[x] = F(1) / np.sqrt(variance + floor)
    return mean, scale


@njit(cache=True, nogil=True, fastmath=True)
def _score(reference, mean, scale, warped, warped_mean, warped_scale, inside, radius, scores):
    """Quantised 1 − max(ZNCC, 0): 0 is a perfect match, WORST none, INVALID outside of the source."""
    height, width = reference.shape
    columns = np.empty(width + 2 * radius, np.float32)
    products = np.empty(width, np.float32)
    inverse_area = F(1) / F((2 * radius + 1) ** 2)
    for y in range(height):
        _column_sums(reference, warped, y, radius, columns)
        _window_sums(columns, radius, products)
        for x in range(width):
            covariance = products[x] * inverse_area - mean[y, x] * warped_mean[y, x]
            zncc = min(max(covariance * scale[y, x] * warped_scale[y, x], F(0)), F(1))
            quantised = np.uint8((F(1) - zncc) * F(WORST) + F(0.5))
            scores[y, x] = quantised if inside[y, x] else INVALID


@njit(cache=True, nogil=True)
def _mean_of_best(scores, best, costs):
    """Mean of the `best` smallest valid scores per pixel; WORST where no source sees it."""
    count, height, width = scores.shape
    smallest = np.empty((best, width), np.uint8)
    passed_on = np.empty(width, np.uint8)
    for y in range(height):
        smallest[:] = INVALID
        for s in range(count):
            passed_on[:] = scores[s, y]
            for rank in range(best):
                row = smallest[rank]
                for x in range(width):
                    lower = min(row[x], passed_on[x])
                    passed_on[x] = max(row[x], passed_on[x])
                    row[x] = lower
        for x in range(width):
            total, used = F(0), F(0)
            for rank in range(best):
                valid = smallest[rank, x] < INVALID
                total += F(smallest[rank, x]) if valid else F(0)
                used += F(1) if valid else F(0)
            costs[y, x] = np.uint8(total / used + F(0.5)) if used > F(0) else WORST


@njit(cache=True, nogil=True, parallel=True)
def _sweep(reference, images, sizes, projections, inverse_depths, radius, best, noise):
    height, width = reference.shape
    ones = np.ones((height, width), np.float32)
    mean, scale = window_statistics(reference, ones, radius, noise)
    by_plane = np.empty((inverse_depths.size, height, width), np.uint8)
    for d in prange(inverse_depths.size):
        warped = np.empty((height, width), np.float32)
        inside = np.empty((height, width), np.bool_)
        scores = np.empty((images.shape[0], height, width), np.uint8)
        for s in range(images.shape[0]):
            _warp(images[s], sizes[s, 0], sizes[s, 1], projections[s], inverse_depths[d], warped, inside)
            warped_mean, warped_scale = window_statistics(warped, ones, radius, noise)
            _score(reference, mean, scale, warped, warped_mean, warped_scale, inside, radius, scores[s])
        _mean_of_best(scores, best, by_plane[d])
    costs = np.empty((height, width, inverse_depths.size), np.uint8)
    for y in prange(height):
        for d in range(inverse_depths.size):
            for x in range(width):
                costs[y, x, d] = by_plane[d, y, x]
    return costs


def matching_costs(
    reference: np.ndarray,
    images: np.ndarray,
    sizes: np.ndarray,
    projections: np.ndarray,
    inverse_depths: np.ndarray,
    *,
    radius: int,
    best: int,
    noise: float,
) -> np.ndarray:
    """Compute the cost of every pixel on every plane, shape (h, w, D), uint8: 0 a perfect match, 254 none.

    Parameters
    ----------
    reference : ndarray, shape (h, w), float32
        Grey values of view i, in [0, 1].
    images : ndarray, shape (S, H, W), float32
        Grey values of the sources, padded to a common size.
    sizes : ndarray, shape (S, 2), int
        (height, width) of each source inside its padding.
    projections : ndarray, shape (S, 3, 4)
        `j_from_i` of each source.
    inverse_depths : ndarray, shape (D,), float32
    radius : int
        Half size of the window, pixels.
    best : int
        How many of the best sources count per pixel and plane.
    noise : float
        Standard deviation of grey values that is not worth matching; flat windows correlate with nothing.
    """
    return _sweep(
        reference, images, sizes, projections.astype(np.float32), inverse_depths, radius, best, F(noise)
    )
