"""A weighted graph over pixels as every pixel sees it: its neighbours, half an edge on either side."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np


@dataclass(frozen=True, eq=False)
class HalfEdges:
    """Edges ``w |ρ_p − ρ_q|``, each kept at both of its ends.

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
    """Build the graph from its edges, (E,) each; weights of edges between the same two pixels add up.

    They add up once, in the order they come in, for both ends: the two weigh the same to the last bit. Edges
    that weigh nothing are dropped. Linear in the edges; beside them and the result, 8 B for each are taken.
    """
    once = _once(size, tail.astype(np.int32, copy=False), head.astype(np.int32, copy=False), weight)
    return HalfEdges(*_at_both_ends(*once))


def aggregated(graph: HalfEdges, group: np.ndarray, count: int, factor: float = 1.0) -> HalfEdges:
    """The graph between groups of pixels: weights add up, times a factor; edges inside a group vanish.

    Parameters
    ----------
    group : ndarray, shape (N,), int32
        Group of every pixel, below `count`.
    """
    edges = _between_groups(graph.first, graph.neighbour, graph.weight, group, np.float32(factor))
    return from_edges(count, *edges)


@numba.njit(cache=True, nogil=True)
def _once(size, tail, head, weight):
    """Every edge at its lower end: first, neighbour (sorted), weight."""
    first = np.zeros(size + 1, np.int64)
    for e in range(tail.size):
        first[min(tail[e], head[e]) + 1] += 1
    for p in range(size):
        first[p + 1] += first[p]
    filled = first[:-1].copy()
    other, own = np.empty(tail.size, np.int32), np.empty(tail.size, np.float32)
    for e in range(tail.size):
        low = min(tail[e], head[e])
        other[filled[low]], own[filled[low]] = max(tail[e], head[e]), weight[e]
        filled[low] += 1
    return _merged(first, other, own)


@numba.njit(cache=True, nogil=True)
def _merged(first, other, weight):
    """Sort every pixel's edges, stably, and add up what meets, in place."""
    kept, begin = 0, 0
    for p in range(first.size - 1):
        end = first[p + 1]
        _sort_by_neighbour(other, weight, begin, end)
        begin_kept = kept
        for k in range(begin, end):
            if kept > begin_kept and other[kept - 1] == other[k]:
                weight[kept - 1] += weight[k]
            elif weight[k] != 0:
                other[kept], weight[kept] = other[k], weight[k]
                kept += 1
        first[p + 1], begin = kept, end
    return first, other[:kept], weight[:kept]


@numba.njit(inline="always")
def _sort_by_neighbour(other, weight, begin, end):
    """By insertion: a pixel has a few dozen edges at most."""
    for k in range(begin + 1, end):
        key, own, at = other[k], weight[k], k
        while at > begin and other[at - 1] > key:
            other[at], weight[at] = other[at - 1], weight[at - 1]
            at -= 1
        other[at], weight[at] = key, own


@numba.njit(cache=True, nogil=True)
def _at_both_ends(first, other, weight):
    """Lower neighbours come first, as they are met; so every pixel's are sorted."""
    size = first.size - 1
    both = np.zeros(size + 1, np.int64)
    for p in range(size):
        both[p + 1] += first[p + 1] - first[p]
        for k in range(first[p], first[p + 1]):
            both[other[k] + 1] += 1
    for p in range(size):
        both[p + 1] += both[p]
    filled = both[:-1].copy()
    neighbour, own = np.empty(2 * other.size, np.int32), np.empty(2 * other.size, np.float32)
    for p in range(size):
        for k in range(first[p], first[p + 1]):
            q = other[k]
            neighbour[filled[q]], own[filled[q]] = p, weight[k]
            filled[q] += 1
    for p in range(size):
        for k in range(first[p], first[p + 1]):
            neighbour[filled[p]], own[filled[p]] = other[k], weight[k]
            filled[p] += 1
    return both, neighbour, own


@numba.njit(cache=True, nogil=True)
def _between_groups(first, neighbour, weight, group, factor):
    """Edges between two groups, each once: the two groups, and the weight."""
    count = 0
    for p in range(first.size - 1):
        for k in range(first[p], first[p + 1]):
            count += group[p] < group[neighbour[k]]
    tail, head, own = np.empty(count, np.int32), np.empty(count, np.int32), np.empty(count, np.float32)
    at = 0
    for p in range(first.size - 1):
        for k in range(first[p], first[p + 1]):
            if group[p] < group[neighbour[k]]:
                tail[at], head[at], own[at] = group[p], group[neighbour[k]], factor * weight[k]
                at += 1
    return tail, head, own
