"""Gram matrices ``Σ_p ρ_p² ν_p ν_pᵀ`` per view and channel: the observability of the light's directions."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.solvers.kernels.simd import lane_sum, load, spread, store, widened
from stages.solvers.kernels.sliced_ellpack import EIGHT, THREE, Blocks
from stages.solvers.primal_dual.iteration_kernels import strides

CHUNK = np.uint64(32)  # slices whose columns stay in the nearest cache


def gram_matrices(blocks: Blocks, basis: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """Compute the Gram matrices, in float64: a plane has one normal, hence rank one among nine directions.

    Parameters
    ----------
    blocks : Blocks
    basis : ndarray, shape (S, K, 1 or 3, 8), float32
        ν, shared by the channels or one per channel.
    albedo : ndarray, shape (S, 3, 8), float32

    Returns
    -------
    ndarray, shape (n, 3, K, K), float64
    """
    size = basis.shape[1]
    sums = np.zeros((blocks.view.size, 3, size, size))
    _sum(blocks.begin, blocks.end, size, basis.ravel(), albedo.ravel(), sums)
    upper = blocks.by_view(sums)
    return upper + np.triu(upper, 1).swapaxes(-1, -2)


@numba.njit(parallel=True, cache=True, nogil=True)
def _sum(begins, ends, size, basis, albedo, sums):
    """Sum the upper triangles, block by block."""
    size = np.uint64(size)
    stride, step = strides(basis, np.uint64(albedo.size), size)
    for block in numba.prange(begins.size):
        columns, scratch = np.empty(size * CHUNK * EIGHT), np.empty(CHUNK * EIGHT)
        end = np.uint64(ends[block])
        for begin in range(np.uint64(begins[block]), end, CHUNK):
            count = min(CHUNK, end - begin)
            for c in range(THREE):
                if c == 0 or step > 0:
                    _widen(basis, begin, count, size, stride, c * step, columns)
                _add_products(columns, albedo, begin, count, size, c, scratch, sums[block, c])


@numba.njit(inline="always")
def _widen(basis, begin, count, size, stride, channel, columns):
    """Widen a chunk's columns of ν to float64."""
    for i in range(count):
        for k in range(size):
            values = load(basis, ((begin + i) * size + k) * stride + channel)
            store(columns, (k * CHUNK + i) * EIGHT, widened(values))


@numba.njit(inline="always")
def _add_products(columns, albedo, begin, count, size, channel, scratch, gram):
    """Add a chunk's products of columns, weighted with ρ²."""
    for k in range(size):
        for i in range(count):
            rho = widened(load(albedo, ((begin + i) * THREE + channel) * EIGHT))
            store(scratch, i * EIGHT, rho * rho * load(columns, (k * CHUNK + i) * EIGHT))
        for j in range(k, size):
            total = spread(np.float64(0))
            for i in range(count):
                total = total + load(scratch, i * EIGHT) * load(columns, (j * CHUNK + i) * EIGHT)
            gram[k, j] += lane_sum(total)
