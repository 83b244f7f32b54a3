"""The graph of pixels in rows of eight half-edges, for the SIMD loops of the solver."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.solvers.kernels.simd import COUNT
from stages.solvers.kernels.sliced_ellpack import Slices
from stages.solvers.primal_dual.half_edges import HalfEdges


@dataclass(frozen=True, eq=False)
class SlicedGraph:
    """Half-edges in rows of eight, one per pixel of a slice; pixels of lower degree are padded with weight 0.

    Attributes
    ----------
    first : ndarray, shape (S + 1,), uint64
        The rows of slice s are ``first[s]:first[s + 1]``.
    neighbour : ndarray, shape (R · 8,), uint32
        Place of the neighbour.
    weight : ndarray, shape (R · 8,), float32
    total : ndarray, shape (S · 8,), float32
        Σ w of a pixel's half-edges; at least `NEARLY_FREE`.
    """

    first: np.ndarray
    neighbour: np.ndarray
    weight: np.ndarray
    total: np.ndarray


WINDOW = 64  # pixels that are sorted by degree together: few, so that neighbours stay close in memory
NEARLY_FREE = 1e-6  # total weight of a pixel without neighbours, against division by 0


def slices_of(graph: HalfEdges, starts: np.ndarray) -> Slices:
    """Group pixels of similar degree into slices, to keep the padding small.

    Parameters
    ----------
    graph : HalfEdges
    starts : ndarray, shape (n + 1,), int64
        View i owns the pixels ``starts[i]:starts[i + 1]``.
    """
    rank = np.empty(graph.size, np.int32)
    for begin, end in zip(starts[:-1], starts[1:], strict=True):
        _rank_by_degree(graph.first, begin, end, rank)
    return Slices.of(starts, rank)


def sliced_graph(graph: HalfEdges, slices: Slices) -> SlicedGraph:
    """Arrange a graph in slices."""
    degree = np.zeros(COUNT * slices.count, np.int64)
    degree[slices.places] = np.diff(graph.first)
    rows = degree.reshape(-1, COUNT).max(axis=1, initial=0)
    first = np.concatenate([[0], np.cumsum(rows)]).astype(np.uint64)
    size = COUNT * int(first[-1])
    neighbour, weight = np.zeros(size, np.uint32), np.zeros(size, np.float32)
    total = np.full(COUNT * slices.count, NEARLY_FREE, np.float32)
    _arrange(
        graph.first,
        graph.neighbour,
        graph.weight,
        slices.places,
        first.view(np.int64),
        neighbour,
        weight,
        total,
    )
    return SlicedGraph(first, neighbour, weight, total)


@numba.njit(cache=True, nogil=True)
def _rank_by_degree(first, begin, end, rank):
    """Rank pixels by descending degree within every window."""
    for own in range(begin, end, WINDOW):
        stop = min(own + WINDOW, end)
        degree = first[own + 1 : stop + 1] - first[own:stop]
        order = np.argsort(-degree, kind="mergesort")
        for k in range(order.size):
            rank[own + order[k]] = own + k


@numba.njit(parallel=True, cache=True, nogil=True)
def _arrange(start, other, weight, places, first, neighbour, row_weight, total):
    for pixel in numba.prange(places.size):
        p = np.int64(pixel)
        slice_, lane = places[p] // COUNT, places[p] % COUNT
        own = 0.0
        for k in range(start[p], start[p + 1]):
            at = (first[slice_] + k - start[p]) * COUNT + lane
            neighbour[at] = places[other[k]]
            row_weight[at] = weight[k]
            own += weight[k]
        total[places[p]] = max(own, NEARLY_FREE)
