"""Compiled loop over pairs of pixels that choose between two shares of a sun."""

from __future__ import annotations

import numba

import stages.solvers.kernels.threading_layer  # noqa: F401


@numba.njit(cache=True, nogil=True)
def pair_costs(albedo, added, weight, free, down, right, edge, step, chroma_step, change, unlike):
    """Add the costs of pairs (down, right) apart, of which a pixel is free; see `Choice`.

    `albedo`, (2, h, w, 3), and `added`, (2, h, w), shadow that the mesh does not explain: where pixels stay,
    where they change. `change`, (h, w), is added to; `unlike`, (h, w), is set, 0 where not both are free.
    """
    rows, columns = weight.shape
    for y in range(rows):
        for x in range(columns):
            unlike[y, x] = 0.0
            v, u = y + down, x + right
            if v >= rows or u < 0 or u >= columns or not (free[y, x] or free[v, u]):
                continue
            both = weight[y, x] * weight[v, u]
            if both <= 0:
                continue
            stay_stay = _cost(albedo, added, 0, y, x, 0, v, u, edge, step, chroma_step)
            stay_change = _cost(albedo, added, 0, y, x, 1, v, u, edge, step, chroma_step)
            change_stay = _cost(albedo, added, 1, y, x, 0, v, u, edge, step, chroma_step)
            change_change = _cost(albedo, added, 1, y, x, 1, v, u, edge, step, chroma_step)
            lacking = max(stay_stay + change_change - stay_change - change_stay, 0.0)
            if stay_change >= change_stay:
                stay_change += lacking
            else:
                change_stay += lacking
            # A free second pixel is charged what it costs where the first one changes, if that may be.
            if free[y, x]:
                change[y, x] += both * (change_stay - stay_stay)
            if free[v, u]:
                by_second = change_change - change_stay if free[y, x] else stay_change - stay_stay
                change[v, u] += both * by_second
            if free[y, x] and free[v, u]:
                unlike[y, x] = both * (stay_change + change_stay - stay_stay - change_change)


@numba.njit(cache=True, nogil=True)
def _cost(albedo, added, a, y, x, b, v, u, edge, step, chroma_step):
    """Compute the disagreement of two log albedos, 0 to 1, and the price of a shadow's edge."""
    mean = 0.0
    for c in range(3):
        mean += (albedo[a, y, x, c] - albedo[b, v, u, c]) / 3
    squared = 0.0
    for c in range(3):
        off = albedo[a, y, x, c] - albedo[b, v, u, c] - mean
        squared += off * off / 3
    far = mean * mean / (step * step) + squared / (chroma_step * chroma_step)
    return far / (1 + far) + edge * abs(added[a, y, x] - added[b, v, u])
