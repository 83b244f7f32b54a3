"""Chambolle and Pock's primal-dual scheme for TV-l¹ problems on a graph of pixels, three channels at once."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.threading_layer  # noqa: F401
from stages.solvers.half_edges import HalfEdges

SHARE, ONE = np.uint64(1024), np.uint64(1)  # pixels that a thread takes at a time
FAST = {"nnan", "ninf", "nsz", "contract"}  # no reordering of sums: an edge's two duals must stay opposite
NOTHING = np.float32(1e-12)  # a pixel whose |shading| is below this says nothing about its albedo


class PrimalDual:
    """Iterates for ``min_ρ Σ_p |I_p − S_p ρ_p| + Σ_{pq} w_pq |ρ_p − ρ_q|`` in every channel.

    Parameters
    ----------
    graph : HalfEdges
    albedo : ndarray, shape (N, 3), float32
        Where to start; not changed.
    scale : float
        r: primal steps are r/degree, dual steps 1/(2 r). Small moves slowly and surely.

    Notes
    -----
    ``y_pq ← clip(y_pq + (ρ̄_p − ρ̄_q)/(2r), ±w_pq)``, ``ρ ← prox(ρ − τ Kᵀy)``, ``ρ̄ ← 2 ρ − ρ_before``
    (Chambolle and Pock 2011, algorithm 1, with the diagonal steps of Pock and Chambolle 2011).

    Both ends of an edge keep their own copy of its dual; the two are negatives of one another to the last
    bit, since rounding is symmetric. So a pixel writes only what is its own: one pass per iteration, no two
    threads meet, and the result does not depend on how many there are.
    """

    def __init__(self, graph: HalfEdges, albedo: np.ndarray, scale: float):
        self._graph, self._scale = graph, np.float32(scale)
        self.albedo = np.ascontiguousarray(albedo, np.float32).copy()
        self._ahead, self._ahead_next = self.albedo.copy(), self.albedo.copy()
        self._dual = np.zeros((graph.neighbour.size, 3), np.float32)

    def iterate(self, image: np.ndarray, shading: np.ndarray, count: int) -> None:
        """Do `count` iterations, an even number, for a given image and shading, (N, 3) float32 each."""
        _iterate(
            self._graph.first.view(np.uint64),
            self._graph.neighbour.view(np.uint32),
            self._graph.weight,
            self._dual,
            self.albedo,
            self._ahead,
            self._ahead_next,
            image,
            shading,
            self._scale,
            count // 2,
        )

    def rescale(self, factors: np.ndarray) -> None:
        """Multiply the albedo by one factor per channel, (3,)."""
        self.albedo *= factors.astype(np.float32)
        self._ahead *= factors.astype(np.float32)


@numba.njit(cache=True, nogil=True)
def _iterate(first, neighbour, weight, dual, albedo, ahead, other, image, shading, scale, pairs):
    """Pairs of iterations: after each pair the extrapolated albedo is back in `ahead`."""
    for _ in range(pairs):
        _sweep(first, neighbour, weight, dual, albedo, ahead, other, image, shading, scale)
        _sweep(first, neighbour, weight, dual, albedo, other, ahead, image, shading, scale)


@numba.njit(parallel=True, cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def _sweep(first, neighbour, weight, dual, albedo, ahead, ahead_next, image, shading, scale):
    """One iteration, in place but for `ahead`, which neighbours still read.

    Unsigned places throughout: numba checks signed ones for negative values, a quarter of the time.
    """
    dual_step = np.float32(0.5) / scale
    pixels = np.uint64(albedo.shape[0])
    for share in numba.prange((pixels + SHARE - ONE) // SHARE):
        for p in range(np.uint64(share) * SHARE, min(pixels, (np.uint64(share) + ONE) * SHARE)):
            begin, end = first[p], first[p + ONE]
            pull = _dual_step(begin, end, neighbour, weight, dual, ahead, p, dual_step)
            step = scale / np.float32(max(end - begin, ONE))
            for c in range(3):
                before = albedo[p, c]
                now = _nearest_to_data(before - step * pull[c], step, image[p, c], shading[p, c])
                albedo[p, c] = now
                ahead_next[p, c] = np.float32(2) * now - before


@numba.njit(inline="always")
def _dual_step(begin, end, neighbour, weight, dual, ahead, p, dual_step):
    """Move the duals of a pixel's half-edges; their sums per channel."""
    red, green, blue = np.float32(0), np.float32(0), np.float32(0)
    own_red, own_green, own_blue = ahead[p, 0], ahead[p, 1], ahead[p, 2]
    for k in range(begin, end):
        q, w = neighbour[k], weight[k]
        a = min(max(dual[k, 0] + dual_step * (own_red - ahead[q, 0]), -w), w)
        b = min(max(dual[k, 1] + dual_step * (own_green - ahead[q, 1]), -w), w)
        c = min(max(dual[k, 2] + dual_step * (own_blue - ahead[q, 2]), -w), w)
        dual[k, 0], dual[k, 1], dual[k, 2] = a, b, c
        red, green, blue = red + a, green + b, blue + c
    return red, green, blue


@numba.njit(inline="always")
def _nearest_to_data(albedo, step, image, shading):
    """``argmin_v step·|image − shading·v| + (v − albedo)²/2``."""
    if abs(shading) < NOTHING:
        return albedo
    misfit = shading * albedo - image
    reach = step * shading * shading
    if misfit > reach:
        return albedo - step * shading
    if misfit < -reach:
        return albedo + step * shading
    return image / shading
