"""Candidate planes of PatchMatch at a pixel, and the charge for bending away from the neighbours.

A plane is (w, slope x, slope y), see `inverse_depth`; `rules` is `patch_match.Rules`. All functions run
inside the loops of `patch_match`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

F = np.float32
NEIGHBOURS = ((0, 1), (0, -1), (1, 0), (-1, 0))
CANDIDATES = 8  # per pixel and round: the draws that `candidate` knows


@njit(cache=True, nogil=True)
def _random(y, x, turn, draw):
    """A number in [−1, 1) from a hash (Murmur's finaliser) of where and when it is drawn."""
    h = np.uint32(y) * np.uint32(0x9E3779B1) ^ np.uint32(x) * np.uint32(0x85EBCA77)
    h ^= np.uint32(turn) * np.uint32(0xC2B2AE3D) ^ np.uint32(draw) * np.uint32(0x27D4EB2F)
    h = np.uint32((h ^ (h >> np.uint32(16))) * np.uint32(0x85EBCA6B))
    h = np.uint32((h ^ (h >> np.uint32(13))) * np.uint32(0xC2B2AE35))
    h = h ^ (h >> np.uint32(16))
    return F(np.float32(h >> np.uint32(8)) * F(1 / 8388608.0) - F(1))


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def bending(planes, y, x, plane, rules):
    """Charge a plane for bending: the neighbours' mean of the truncated squared gap, px² of disparity."""
    height, width, _ = planes.shape
    total = F(0)
    for dy, dx in NEIGHBOURS:
        row, column = y + dy, x + dx
        if 0 <= row < height and 0 <= column < width:
            ahead = plane[0] + plane[1] * F(dx) + plane[2] * F(dy) - planes[row, column, 0]
            behind = (
                planes[row, column, 0]
                - planes[row, column, 1] * F(dx)
                - planes[row, column, 2] * F(dy)
                - plane[0]
            )
            off = (abs(ahead) + abs(behind)) * F(0.5) / rules.step
            total += min(off * off, rules.bending_cap)
    return rules.smoothness * F(0.25) * total


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def nearly_same(a, b, rules):
    """Tell whether two planes differ by too little to be worth a comparison."""
    return (
        abs(a[0] - b[0]) < rules.same_disparity * rules.step
        and abs(a[1] - b[1]) < rules.same_slope * rules.step
        and abs(a[2] - b[2]) < rules.same_slope * rules.step
    )


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def candidate(planes, costs, y, x, turn, draw, rules, amplitude):
    """Propose an alternative plane: 0–3 the best neighbour of an arm, 4 the local slope, 5–7 random."""
    height, width, _ = planes.shape
    w, slope_x, slope_y = planes[y, x, 0], planes[y, x, 1], planes[y, x, 2]
    if draw < 4:
        dy, dx = NEIGHBOURS[draw]
        lowest, reach = F(1e9), 0
        for distance in rules.propagation:
            row, column = y + dy * distance, x + dx * distance
            if 0 <= row < height and 0 <= column < width and costs[row, column] < lowest:
                lowest, reach = costs[row, column], distance
        row, column = y + dy * reach, x + dx * reach
        slope_x, slope_y = planes[row, column, 1], planes[row, column, 2]
        return planes[row, column, 0] - slope_x * F(dx * reach) - slope_y * F(dy * reach), slope_x, slope_y
    if draw == 4:
        left, right = planes[y, max(x - 1, 0), 0], planes[y, min(x + 1, width - 1), 0]
        above, below = planes[max(y - 1, 0), x, 0], planes[min(y + 1, height - 1), x, 0]
        return (left + right + above + below) * F(0.25), (right - left) * F(0.5), (below - above) * F(0.5)
    if draw != 6:
        w += rules.step * amplitude * _random(y, x, turn, 3 * draw)
    if draw != 5:
        slope_x += rules.step * amplitude * rules.slope_change * _random(y, x, turn, 3 * draw + 1)
        slope_y += rules.step * amplitude * rules.slope_change * _random(y, x, turn, 3 * draw + 2)
    return w, slope_x, slope_y
