"""Compiled, matrix-free, Jacobi-preconditioned conjugate gradients on the graph, three channels at once."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.solvers.primal_dual.half_edges import HalfEdges

BLOCK = 1024  # pixels that a thread takes at a time


def reweighted_descent(
    graph: HalfEdges,
    image: np.ndarray,
    shading: np.ndarray,
    albedo: np.ndarray,
    delta: float,
    steps: int,
) -> np.ndarray:
    """Reweight once by Eq. 13 at `albedo`, and take some steps on the normal equations from there.

    Parameters
    ----------
    graph : HalfEdges
        λ and μ are in its weights.
    image, shading, albedo : ndarray, shape (N, 3), float32
    delta : float
    steps : int

    Returns
    -------
    ndarray, shape (N, 3), float32
        Vectors are float32, inner products float64.
    """
    edges = graph.first, graph.neighbour, graph.weight
    weight = np.empty((graph.neighbour.size, 3), np.float32)
    data, inverse = np.empty_like(albedo), np.empty_like(albedo)
    residual, direction = np.empty_like(albedo), np.empty_like(albedo)
    sums = np.zeros((-(-graph.size // BLOCK), 3))
    _reweigh(
        edges, image, shading, albedo, np.float32(delta), weight, data, inverse, residual, direction, sums
    )
    x, product, before = albedo.copy(), np.empty_like(albedo), sums.sum(axis=0)
    for _ in range(steps):
        _multiply(edges, weight, data, direction, product, sums)
        alpha = _ratio(before, sums.sum(axis=0))
        _advance(alpha, direction, product, inverse, x, residual, sums)
        after = sums.sum(axis=0)
        _turn(_ratio(after, before), inverse, residual, direction)
        before = after
    return x


def _ratio(above: np.ndarray, below: np.ndarray) -> np.ndarray:
    """Divide per channel; 0 where the residual is 0."""
    return np.where(below > 0, above / np.where(below > 0, below, 1), 0).astype(np.float32)


@numba.njit(parallel=True, cache=True, nogil=True)
def _reweigh(edges, image, shading, albedo, delta, weight, data, inverse, residual, direction, sums):
    """Compute weights of Eq. 12 and 14 to 16, the diagonal, the first residual and direction."""
    first, neighbour, base = edges
    size, one = albedo.shape[0], np.float32(1)
    for block in numba.prange(sums.shape[0]):
        sums[block] = 0
        for p in range(block * BLOCK, min(size, (block + 1) * BLOCK)):
            for c in range(3):
                s, rho = shading[p, c], albedo[p, c]
                misfit = image[p, c] - rho * s
                w = one / max(abs(misfit), delta)
                data[p, c] = w * s * s
                degree, pull = np.float32(0), w * s * misfit
                for k in range(first[p], first[p + 1]):
                    difference = albedo[neighbour[k], c] - rho
                    weight[k, c] = base[k] / max(abs(difference), delta)
                    degree += weight[k, c]
                    pull += weight[k, c] * difference
                diagonal = data[p, c] + degree
                inverse[p, c] = one / diagonal if diagonal > 0 else one
                residual[p, c] = pull
                direction[p, c] = inverse[p, c] * pull
                sums[block, c] += np.float64(pull) * direction[p, c]


@numba.njit(parallel=True, cache=True, nogil=True)
def _multiply(edges, weight, data, direction, product, sums):
    """Compute ``product = A direction`` and its inner product with the direction."""
    first, neighbour, _ = edges
    size = direction.shape[0]
    for block in numba.prange(sums.shape[0]):
        sums[block] = 0
        for p in range(block * BLOCK, min(size, (block + 1) * BLOCK)):
            red, green, blue = direction[p, 0], direction[p, 1], direction[p, 2]
            a, b, c = data[p, 0] * red, data[p, 1] * green, data[p, 2] * blue
            for k in range(first[p], first[p + 1]):
                q = neighbour[k]
                a += weight[k, 0] * (red - direction[q, 0])
                b += weight[k, 1] * (green - direction[q, 1])
                c += weight[k, 2] * (blue - direction[q, 2])
            product[p, 0], product[p, 1], product[p, 2] = a, b, c
            sums[block, 0] += np.float64(red) * a
            sums[block, 1] += np.float64(green) * b
            sums[block, 2] += np.float64(blue) * c


@numba.njit(parallel=True, cache=True, nogil=True)
def _advance(alpha, direction, product, inverse, x, residual, sums):
    size = x.shape[0]
    for block in numba.prange(sums.shape[0]):
        sums[block] = 0
        for p in range(block * BLOCK, min(size, (block + 1) * BLOCK)):
            for c in range(3):
                x[p, c] += alpha[c] * direction[p, c]
                r = residual[p, c] - alpha[c] * product[p, c]
                residual[p, c] = r
                sums[block, c] += np.float64(r) * inverse[p, c] * r


@numba.njit(parallel=True, cache=True, nogil=True)
def _turn(beta, inverse, residual, direction):
    for p in numba.prange(direction.shape[0]):
        for c in range(3):
            direction[p, c] = inverse[p, c] * residual[p, c] + beta[c] * direction[p, c]
