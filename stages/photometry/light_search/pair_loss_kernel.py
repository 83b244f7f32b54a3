"""Compiled loop over pairs of pixels: the loss of their log albedos, and its gradient."""

from __future__ import annotations

import numba

import stages.solvers.kernels.threading_layer  # noqa: F401


@numba.njit(cache=True, nogil=True)
def pair_losses(values, trust, first, second, weight, scale, colour, slope):
    """Sum ``weight · u/(1 + u)`` with ``u = (m² + colour² v) / scale²``; add its gradient to `slope`.

    m is the mean of the channels' differences, v their variance, each channel weighted by its trust.
    """
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
