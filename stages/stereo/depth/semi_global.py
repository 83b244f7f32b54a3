"""Semi-global aggregation (Hirschmüller 2008) of a plane-sweep volume, and its winner.

Along each of 4 or 8 directions r, with C the matching cost, d a plane and p − r the previous pixel of the
path,

    L_r(p, d) = C(p, d) + min( L_r(p−r, d), L_r(p−r, d±1) + P1, min_k L_r(p−r, k) + P2 ) − min_k L_r(p−r, k)

and the planes compete by Σ_r L_r. P2 falls where the image has an edge, since depth edges are seen as such.
All values are whole numbers below 2²⁴ (held as float32, which vectorises best) and the lines of one
direction never meet, so the bits do not depend on the number of threads.

Memory: two bytes per pixel and plane for the sum.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

import stages.solvers.kernels.threading_layer  # noqa: F401 -- chooses the threads below
from stages.stereo.mvs_settings import MvsSettings

F = np.float32
FAR = F(1 << 20)  # above any sum along a path, and far below 2²⁴


def _line_starts(height: int, width: int, dy: int, dx: int) -> np.ndarray:
    """First pixels (row, column) of all lines of one direction, (n, 2): their predecessors are outside."""
    rows, columns = np.indices((height, width)).reshape(2, -1)
    before_y, before_x = rows - dy, columns - dx
    first = (before_y < 0) | (before_y >= height) | (before_x < 0) | (before_x >= width)
    return np.stack([rows[first], columns[first]], axis=1)


@njit(cache=True, nogil=True, fastmath=True)
def _step(cost, before, lowest, small, large, now, total):
    """One pixel of a path; `before` and `now` carry a guard cell at both ends. Returns its minimum."""
    for d in range(cost.size):
        stay = min(before[d + 1], min(before[d], before[d + 2]) + small)
        now[d + 1] = F(cost[d]) + min(stay, lowest + large) - lowest
    smallest = FAR
    for d in range(cost.size):
        smallest = min(smallest, now[d + 1])
        total[d] += np.uint16(now[d + 1])
    return smallest


@njit(cache=True, nogil=True, parallel=True)
def _aggregate_direction(costs, guide, starts, dy, dx, small, large, edge, total):
    height, width, planes = costs.shape
    for line in prange(starts.shape[0]):
        before = np.zeros(planes + 2, np.float32)
        now = np.zeros(planes + 2, np.float32)
        before[0] = before[planes + 1] = now[0] = now[planes + 1] = FAR
        y, x = starts[line, 0], starts[line, 1]
        lowest = F(0)
        grey = guide[y, x]
        while 0 <= y < height and 0 <= x < width:
            ratio = abs(guide[y, x] - grey) / edge
            jump = max(np.floor(large / (F(1) + ratio)), small + F(1))
            grey = guide[y, x]
            lowest = _step(costs[y, x], before, lowest, small, jump, now, total[y, x])
            before, now = now, before
            y += dy
            x += dx


def aggregate(costs: np.ndarray, guide: np.ndarray, settings: MvsSettings) -> np.ndarray:
    """Sum matching costs along paths, Σ_r L_r.

    Parameters
    ----------
    costs : ndarray, shape (h, w, D), uint8
    guide : ndarray, shape (h, w), float32
        Grey values whose edges lower P2.
    settings : MvsSettings
        `sgm_paths`: 4 (along the axes) or 8 (diagonals too). `sgm_small` and `sgm_large`, P1 and P2 on an
        even image, in units of the cost (254: no correlation at all). `sgm_edge`, the grey-value difference
        (of 1) at which P2 has fallen to one half.

    Returns
    -------
    ndarray, shape (h, w, D), uint16
    """
    height, width, _ = costs.shape
    total = np.zeros(costs.shape, np.uint16)
    directions = [(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)][: settings.sgm_paths]
    for dy, dx in directions:
        starts = _line_starts(height, width, dy, dx)
        _aggregate_direction(
            costs,
            guide,
            starts,
            dy,
            dx,
            F(settings.sgm_small),
            F(settings.sgm_large),
            F(settings.sgm_edge),
            total,
        )
    return total


@njit(cache=True, nogil=True, parallel=True)
def winner(total: np.ndarray) -> np.ndarray:
    """Find the plane of the smallest sum, refined by the parabola through its neighbours, (h, w), float32."""
    height, width, planes = total.shape
    index = np.empty((height, width), np.float32)
    for y in prange(height):
        for x in range(width):
            d = np.argmin(total[y, x])
            index[y, x] = d
            if 0 < d < planes - 1:
                left, mid, right = (
                    np.int32(total[y, x, d - 1]),
                    np.int32(total[y, x, d]),
                    np.int32(total[y, x, d + 1]),
                )
                bend = left - 2 * mid + right
                if bend > 0:
                    index[y, x] += F(left - right) / F(2 * bend)
    return index
