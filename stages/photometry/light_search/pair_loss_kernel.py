"""Compiled loops over pairs of pixels: the loss of their log albedos, and its slope."""

from __future__ import annotations

import numba

import stages.solvers.kernels.threading_layer  # noqa: F401

NO_TRUST = 1e-9  # added to a sum of trusts that is divided by


@numba.njit(cache=True, parallel=True, nogil=True)
def shares_of_channels(trust, first, second, shares):
    """Compute how much each channel counts in the difference of a pair, (m, 3): 1 together, or 0."""
    for k in numba.prange(first.size):
        one, other = trust[first[k]], trust[second[k]]
        red, green, blue = one[0] * other[0], one[1] * other[1], one[2] * other[2]
        total = NO_TRUST + red + green + blue
        shares[k, 0], shares[k, 1], shares[k, 2] = red / total, green / total, blue / total


@numba.njit(cache=True, parallel=True, nogil=True)
def sum_losses(logs, pairs, scale, colour, totals):
    """Sum ``weight · u/(1 + u)`` with ``u = (m² + colour² v) / scale²``, of as many parts of the pairs.

    m is the mean of the channels' differences, v their variance, by the shares of `pairs`: both ends, (m,),
    shares, (m, 3), and weight, (m,).
    """
    (first, second, shares, weight), by_scale = pairs, 1 / (scale * scale)
    for part in numba.prange(len(totals)):
        total = 0.0
        for k in range(*_pairs_of(part, len(totals), first.size)):
            u = _apart(logs, first[k], second[k], shares[k], colour)[0] * by_scale
            total += weight[k] * u / (1 + u)
        totals[part] = total


@numba.njit(cache=True, parallel=True, nogil=True)
def sum_slopes(logs, pairs, scale, colour, totals, slopes):
    """Sum as `sum_losses`, and add the slopes by `logs` of every part to its own, (parts, n, 3)."""
    (first, second, shares, weight), by_scale = pairs, 1 / (scale * scale)
    for part in numba.prange(len(totals)):
        total, slope = 0.0, slopes[part]
        for k in range(*_pairs_of(part, len(totals), first.size)):
            a, b, share = first[k], second[k], shares[k]
            squared, mean, red, green, blue = _apart(logs, a, b, share, colour)
            close = 1 / (1 + squared * by_scale)
            total += weight[k] * (1 - close)
            pull, coloured = 2 * by_scale * weight[k] * close * close, colour * colour
            red = pull * share[0] * (mean + coloured * red)
            green = pull * share[1] * (mean + coloured * green)
            blue = pull * share[2] * (mean + coloured * blue)
            slope[a, 0] += red
            slope[a, 1] += green
            slope[a, 2] += blue
            slope[b, 0] -= red
            slope[b, 1] -= green
            slope[b, 2] -= blue
        totals[part] = total


@numba.njit(inline="always")
def _pairs_of(part, parts, count):
    return part * count // parts, (part + 1) * count // parts


@numba.njit(inline="always")
def _apart(logs, a, b, share, colour):
    """Compute ``m² + colour² v`` of a pair, m, and how far each channel's difference is from it."""
    red, green, blue = logs[a, 0] - logs[b, 0], logs[a, 1] - logs[b, 1], logs[a, 2] - logs[b, 2]
    mean = share[0] * red + share[1] * green + share[2] * blue
    red, green, blue = red - mean, green - mean, blue - mean
    variance = share[0] * red * red + share[1] * green * green + share[2] * blue * blue
    whole = share[0] + share[1] + share[2]
    return whole * mean * mean + colour * colour * variance, mean, red, green, blue
