"""Compiled loop over pairs of pixels: the loss of their log albedos, and its gradient."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401

PARTS = 8  # of the pairs, with sums of their own; affects speed, and the order of sums


@numba.njit(parallel=True, cache=True, nogil=True)
def pair_losses(values, trust, first, second, weight, scale, colour, slope):
    """Sum ``weight · u/(1 + u)`` with ``u = (m² + colour² v) / scale²``; add its gradient to `slope`.

    m is the mean of the channels' differences, v their variance, each channel weighted by its trust.
    """
    totals, slopes = np.zeros(PARTS), np.zeros((PARTS, slope.shape[0], slope.shape[1]))
    for part in numba.prange(PARTS):
        begin, end = part * first.size // PARTS, (part + 1) * first.size // PARTS
        own = values, trust, first[begin:end], second[begin:end], weight[begin:end]
        totals[part] = _losses_of_part(*own, scale, colour, slopes[part])
    total = 0.0
    for part in range(PARTS):  # `totals.sum()` would add in an order that depends on the threads
        total += totals[part]
        slope += slopes[part]
    return total


@numba.njit(nogil=True)
def _losses_of_part(values, trust, first, second, weight, scale, colour, slope):
    total = 0.0
    for k in range(first.size):
        a, b = first[k], second[k]
        shared, mean, squared = 1e-9, 0.0, 0.0
        for c in range(values.shape[1]):
            both = trust[a, c] * trust[b, c]
            shared += both
            mean += both * (values[a, c] - values[b, c])
        mean /= shared
        for c in range(values.shape[1]):
            off = colour * (values[a, c] - values[b, c] - mean)
            squared += trust[a, c] * trust[b, c] * (mean * mean + off * off)
        u = squared / (shared * scale * scale)
        total += weight[k] * u / (1 + u)
        pull = 2 * weight[k] / ((1 + u) * (1 + u) * scale * scale * shared)
        for c in range(values.shape[1]):
            off = values[a, c] - values[b, c] - mean
            force = pull * trust[a, c] * trust[b, c] * (mean + colour * colour * off)
            slope[a, c] += force
            slope[b, c] -= force
    return total
