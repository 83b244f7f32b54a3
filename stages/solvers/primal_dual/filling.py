"""Initial duals of the edges within the groups of a coarser level, to balance the forces on their pixels.

A coarser level has no such edges. With duals of 0 there, every pixel is at first subject to the unbalanced
duals of its edges to other groups, which disturbs a converged albedo for a hundred iterations.
"""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.solvers.kernels.sliced_ellpack import Blocks, held_at
from stages.solvers.primal_dual.duality_gap import UNIT
from stages.solvers.primal_dual.sliced_graph import NEARLY_FREE, SlicedGraph


def fill_in(
    blocks: Blocks,
    group: np.ndarray,
    graph: SlicedGraph,
    duals: tuple[np.ndarray, np.ndarray],
    share: np.ndarray,
    multiplier: np.ndarray,
    shading: np.ndarray,
) -> None:
    """Set the duals within each group so that they balance the forces on its pixels.

    Parameters
    ----------
    blocks : Blocks
    group : ndarray, shape (S · 8,), int32
        Group of every place.
    graph : SlicedGraph
    duals : tuple of ndarray
        Of edges, int16, overwritten within groups; of data, (S, 3, 8), float32.
    share : ndarray, shape (S, 1, 8), float32
    multiplier : ndarray, shape (n, 3), float32
        m of every view.
    shading : ndarray, shape (S, 3, 8), float32
        S; overwritten.

    Notes
    -----
    With ``f_p = Σ_outside w z + S x − m``, the potentials φ solve ``Σ_within w (φ_p − φ_q) = −f_p``, and
    ``z_pq = φ_p − φ_q``, clipped to ±1. Jacobi's iteration is ``φ ← φ + t (−f/W − φ + mean φ_q)``, the mean
    weighted by w, W = Σ_within w. In groups of up to 2×2 pixels with equal weights its operator has the
    eigenvalues 0, 1 and 2. Two steps, t = 1 and ½, are then exact: ``φ = −f/W``, plus half the mean of the
    neighbours'. The residual of f is the same share of W in all pixels of a group. With unequal weights the
    residual is greater, but the factor (1 − e)(1 − e/2), e from 0 to 2, amplifies nothing. The error of
    clipping is not corrected.
    """
    edge_dual, data_dual = duals
    ways = graph.first, graph.neighbour, graph.weight
    ranges = blocks.view, blocks.begin, blocks.end
    _potentials(ranges, group, ways, edge_dual, data_dual.ravel(), share.ravel(), multiplier, shading.ravel())
    even = np.zeros_like(shading)
    _even_out(group, ways, shading.ravel(), even.ravel())
    _set_duals(group, ways, even.ravel(), edge_dual)


@numba.njit(parallel=True, cache=True, nogil=True)
def _potentials(blocks, group, graph, edge_dual, data_dual, share, multiplier, potential):
    """Compute ``−f / W``, overwriting S."""
    (views, begins, ends), (first, neighbour, weight) = blocks, graph
    for block in numba.prange(views.size):
        kept, pull = multiplier[views[block]], np.empty(3, np.float32)
        for own in range(begins[block] * 8, ends[block] * 8):
            within, pull[:] = np.float32(0), 0
            for at in _half_edges(first, own):
                if group[own] == group[neighbour[at]]:
                    within += weight[at]
                else:
                    for c in range(3):
                        pull[c] += weight[at] * edge_dual[held_at(at, c)] / UNIT
            for c in range(3):
                at = held_at(own, c)
                pull[c] += potential[at] * data_dual[at] - share[own] * min(kept[c], abs(potential[at]))
                potential[at] = -pull[c] / max(within, NEARLY_FREE)


@numba.njit(parallel=True, cache=True, nogil=True)
def _even_out(group, graph, potential, even):
    """Add half the weighted mean over the neighbours within the group; `even` starts as zeros."""
    first, neighbour, weight = graph
    for place in numba.prange(group.size):
        own, within = np.int64(place), np.float32(0)
        for at in _half_edges(first, own):
            if group[own] == group[neighbour[at]]:
                within += weight[at]
                for c in range(3):
                    even[held_at(own, c)] += weight[at] * potential[held_at(np.int64(neighbour[at]), c)]
        for c in range(3):
            at = held_at(own, c)
            even[at] = potential[at] + even[at] / (2 * max(float(within), NEARLY_FREE))


@numba.njit(parallel=True, cache=True, nogil=True)
def _set_duals(group, graph, potential, edge_dual):
    """Set ``z = φ_p − φ_q`` within groups, antisymmetric to the last bit, since rounding is symmetric."""
    first, neighbour, weight = graph
    for place in numba.prange(group.size):
        own = np.int64(place)
        for at in _half_edges(first, own):
            if weight[at] > 0 and group[own] == group[neighbour[at]]:
                for c in range(3):
                    rise = potential[held_at(own, c)] - potential[held_at(np.int64(neighbour[at]), c)]
                    edge_dual[held_at(at, c)] = np.rint(UNIT * min(max(rise, np.float32(-1)), np.float32(1)))


@numba.njit(inline="always")
def _half_edges(first, own):
    """List the places of a pixel's half-edges."""
    return range(np.int64(first[own // 8]) * 8 + own % 8, np.int64(first[own // 8 + 1]) * 8, 8)
