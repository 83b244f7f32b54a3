"""Compiled loops over pairs of pixels: the loss of their log albedos, and its gradient."""

from __future__ import annotations

import numba

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.solvers.kernels.equal_parts import part_of

LEAST_TRUST = 1e-9  # of all channels of a pair together; pairs that are nearly black count for less


@numba.njit(cache=True, parallel=True, nogil=True)
def share_among_channels(trust, first, second, shares):
    """Compute each channel's share in a pair's difference, (m, 3); they sum to 1, or less if it is black."""
    for k in numba.prange(first.size):
        one, other = trust[first[k]], trust[second[k]]
        red, green, blue = one[0] * other[0], one[1] * other[1], one[2] * other[2]
        total = LEAST_TRUST + red + green + blue
        shares[k, 0], shares[k, 1], shares[k, 2] = red / total, green / total, blue / total


@numba.njit(cache=True, parallel=True, nogil=True)
def sum_losses(logs, pairs, scale, colour, totals):
    """Sum ``weight · u/(1 + u)`` with ``u = (m² + colour² v) / scale²`` over each of P parts of the pairs.

    m is the mean of the channels' differences of `logs`, (n, 3), and v their variance, by the shares of
    `pairs`: both ends, (m,), shares, (m, 3), and weight, (m,). Writes `totals`, (P,).
    """
    (first, second, shares, weight), by_scale = pairs, 1 / (scale * scale)
    for part in numba.prange(len(totals)):
        total = 0.0
        for k in range(*part_of(part, len(totals), first.size)):
            u = _apart(logs, first[k], second[k], shares[k], colour)[0] * by_scale
            total += weight[k] * u / (1 + u)
        totals[part] = total


@numba.njit(cache=True, parallel=True, nogil=True)
def sum_slopes(logs, pairs, scale, colour, totals, slopes):
    """Sum as `sum_losses` does, and add the gradient by `logs` of each part to `slopes`, (P, n, 3)."""
    (first, second, shares, weight), by_scale = pairs, 1 / (scale * scale)
    for part in numba.prange(len(totals)):
        total, slope = 0.0, slopes[part]
        for k in range(*part_of(part, len(totals), first.size)):
            a, b, share = first[k], second[k], shares[k]
            squared, mean, whole, red, green, blue = _apart(logs, a, b, share, colour)
            close = 1 / (1 + squared * by_scale)
            total += weight[k] * (1 - close)
            pull, varied = 2 * by_scale * weight[k] * close * close, colour * colour
            of_mean = (whole - varied * (1 - whole)) * mean
            force_red = pull * share[0] * (of_mean + varied * red)
            force_green = pull * share[1] * (of_mean + varied * green)
            force_blue = pull * share[2] * (of_mean + varied * blue)
            slope[a, 0] += force_red
            slope[a, 1] += force_green
            slope[a, 2] += force_blue
            slope[b, 0] -= force_red
            slope[b, 1] -= force_green
            slope[b, 2] -= force_blue
        totals[part] = total


@numba.njit(inline="always")
def _apart(logs, a, b, share, colour):
    """Compute ``m² + colour² v`` of a pair, m, the sum of shares, and each channel's deviation from m."""
    red, green, blue = logs[a, 0] - logs[b, 0], logs[a, 1] - logs[b, 1], logs[a, 2] - logs[b, 2]
    whole = share[0] + share[1] + share[2]
    mean = share[0] * red + share[1] * green + share[2] * blue
    red, green, blue = red - mean, green - mean, blue - mean
    variance = share[0] * red * red + share[1] * green * green + share[2] * blue * blue
    return whole * mean * mean + colour * colour * variance, mean, whole, red, green, blue
