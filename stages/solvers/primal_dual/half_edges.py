"""A weighted graph over pixels as adjacency lists: every edge is stored as two half-edges."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401


@dataclass(frozen=True, eq=False)
class HalfEdges:
    """Edges ``w |ρ_p − ρ_q|``, each stored at both of its ends.

    Attributes
    ----------
    first : ndarray, shape (N + 1,), int64
        The half-edges of pixel p are ``first[p]:first[p + 1]``.
    neighbour : ndarray, shape (H,), int32
        The pixel at the other end; sorted within a pixel.
    weight : ndarray, shape (H,), float32
    """

    first: np.ndarray
    neighbour: np.ndarray
    weight: np.ndarray

    @property
    def size(self) -> int:
        """N, the number of pixels."""
        return self.first.size - 1


def from_edges(size: int, tail: np.ndarray, head: np.ndarray, weight: np.ndarray) -> HalfEdges:
    """Build the graph from its edges, (E,) each; weights of parallel edges are summed.

    They are summed in the order of the edges, at both ends, so that both weights agree to the last bit. Edges
    of weight 0 are dropped. Every thread scans all edges for those that end among the pixels it owns, and
    sorts a pixel's by insertion: linear in the edges while pixels have a few dozen each, quadratic in those
    of a single pixel. Where edges are merged, the result is briefly stored twice.
    """
    tail, head = tail.astype(np.int32, copy=False), head.astype(np.int32, copy=False)
    owned = _shares(size)
    first = _from_degrees(_degrees(owned, tail, head))
    neighbour, own = _at_both_ends(owned, first, tail, head, weight)
    kept = _from_degrees(_merge(first, neighbour, own))
    if kept[-1] == first[-1]:
        return HalfEdges(first, neighbour, own)
    return HalfEdges(kept, *_closed_up(first, kept, neighbour, own))


def aggregated(graph: HalfEdges, group: np.ndarray, count: int, factor: float = 1.0) -> HalfEdges:
    """Build the graph between groups of pixels: summed weights times a factor; inner edges are dropped.

    Parameters
    ----------
    group : ndarray, shape (N,), int32
        Group of every pixel, below `count`.
    """
    owned = _shares(graph.size)
    begin = _from_degrees(_crossing(owned, graph.first, graph.neighbour, group))
    edges = _between_groups(
        owned, begin, graph.first, graph.neighbour, graph.weight, group, np.float32(factor)
    )
    return from_edges(count, *edges)


def _shares(size: int) -> np.ndarray:
    """Divide pixels among threads, ``shares[b]:shares[b + 1]`` for thread b; changes no result."""
    return np.linspace(0, size, numba.get_num_threads() + 1).astype(np.int64)


def _from_degrees(degree: np.ndarray) -> np.ndarray:
    """Compute the offsets of the half-edges of every pixel, (N + 1,)."""
    return np.concatenate([[0], np.cumsum(degree, dtype=np.int64)])


@numba.njit(parallel=True, cache=True, nogil=True)
def _degrees(owned, tail, head):
    """Count the ends of edges at every pixel."""
    degree = np.zeros(owned[-1], np.int32)
    for share in numba.prange(owned.size - 1):
        begin, end = owned[share], owned[share + 1]
        for e in range(tail.size):
            if begin <= tail[e] < end:
                degree[tail[e]] += 1
            if begin <= head[e] < end:
                degree[head[e]] += 1
    return degree


@numba.njit(parallel=True, cache=True, nogil=True)
def _at_both_ends(owned, first, tail, head, weight):
    """List neighbour and weight of every half-edge, in the order of the edges."""
    neighbour, own = np.empty(first[-1], np.int32), np.empty(first[-1], np.float32)
    filled = first[:-1].copy()
    for share in numba.prange(owned.size - 1):
        begin, end = owned[share], owned[share + 1]
        for e in range(tail.size):
            t, h = tail[e], head[e]
            if begin <= t < end:
                neighbour[filled[t]], own[filled[t]] = h, weight[e]
                filled[t] += 1
            if begin <= h < end:
                neighbour[filled[h]], own[filled[h]] = t, weight[e]
                filled[h] += 1
    return neighbour, own


@numba.njit(parallel=True, cache=True, nogil=True)
def _merge(first, other, weight):
    """Sort every pixel's half-edges, stably, and merge parallel ones, in place; returns the degrees."""
    degree = np.empty(first.size - 1, np.int32)
    for pixel in numba.prange(first.size - 1):
        p = np.int64(pixel)
        begin, end = first[p], first[p + 1]
        _sort_by_neighbour(other, weight, begin, end)
        kept = begin
        for k in range(begin, end):
            if kept > begin and other[kept - 1] == other[k]:
                weight[kept - 1] += weight[k]
            elif weight[k] != 0:
                other[kept], weight[kept] = other[k], weight[k]
                kept += 1
        degree[p] = kept - begin
    return degree


@numba.njit(inline="always")
def _sort_by_neighbour(other, weight, begin, end):
    """Sort by insertion: a pixel has a few dozen edges."""
    for k in range(begin + 1, end):
        key, own, at = other[k], weight[k], k
        while at > begin and other[at - 1] > key:
            other[at], weight[at] = other[at - 1], weight[at - 1]
            at -= 1
        other[at], weight[at] = key, own


@numba.njit(parallel=True, cache=True, nogil=True)
def _closed_up(first, kept, other, weight):
    """Compact neighbours and weights of the remaining half-edges."""
    neighbour, own = np.empty(kept[-1], np.int32), np.empty(kept[-1], np.float32)
    for pixel in numba.prange(first.size - 1):
        p = np.int64(pixel)
        for k in range(kept[p + 1] - kept[p]):
            neighbour[kept[p] + k], own[kept[p] + k] = other[first[p] + k], weight[first[p] + k]
    return neighbour, own


@numba.njit(parallel=True, cache=True, nogil=True)
def _crossing(owned, first, neighbour, group):
    """Count the edges between groups per share of pixels, each at its lower group."""
    count = np.zeros(owned.size - 1, np.int64)
    for share in numba.prange(owned.size - 1):
        for p in range(owned[share], owned[share + 1]):
            for k in range(first[p], first[p + 1]):
                count[share] += group[p] < group[neighbour[k]]
    return count


@numba.njit(parallel=True, cache=True, nogil=True)
def _between_groups(owned, begin, first, neighbour, weight, group, factor):
    """List the edges between groups, each once: both groups, and the weight."""
    count = begin[-1]
    tail, head, own = np.empty(count, np.int32), np.empty(count, np.int32), np.empty(count, np.float32)
    for share in numba.prange(owned.size - 1):
        at = begin[share]
        for p in range(owned[share], owned[share + 1]):
            for k in range(first[p], first[p + 1]):
                if group[p] < group[neighbour[k]]:
                    tail[at], head[at], own[at] = group[p], group[neighbour[k]], factor * weight[k]
                    at += 1
    return tail, head, own
