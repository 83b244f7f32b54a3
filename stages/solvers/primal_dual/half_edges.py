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
    of a single pixel. Where edges are merged or dropped, the arrays begin larger ones.
    """
    tail, head = tail.astype(np.int32, copy=False), head.astype(np.int32, copy=False)
    owned = _shares(size)
    first = _from_degrees(_degrees(owned, tail, head))
    neighbour, own = _at_both_ends(owned, first, tail, head, weight)
    kept = _from_degrees(_merge(first, neighbour, own))
    if kept[-1] < first[-1]:
        _close_up(first, kept, neighbour, own)
    return HalfEdges(kept, neighbour[: kept[-1]], own[: kept[-1]])


def aggregated(graph: HalfEdges, group: np.ndarray, count: int, factor: float = 1.0) -> HalfEdges:
    """Build the graph between groups of pixels: summed weights times a factor; inner edges are dropped.

    Parameters
    ----------
    group : ndarray, shape (N,), int32
        Group of every pixel, below `count`.

    Notes
    -----
    Parallel edges are merged at the lower group before they are listed: there are several times as many.
    """
    pixels = np.argsort(group, kind="stable").astype(np.int32)  # those of every group, ascending
    begin = _from_degrees(np.bincount(group, minlength=count))
    owned = _shares(count)
    of_graph = graph.first, graph.neighbour, graph.weight, group, np.float32(factor)
    first = _from_degrees(_degrees_upwards(owned, begin, pixels, *of_graph))
    return from_edges(count, *_between_groups(owned, first, begin, pixels, *of_graph))


def half_edges_of(first: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """List the half-edges of n pixels, those of the first, then those of the next, …, int64."""
    counts = first[pixels + 1] - first[pixels]
    ends = np.cumsum(counts)
    return np.arange(ends[-1] if len(ends) else 0) + np.repeat(first[pixels] - (ends - counts), counts)


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


@numba.njit(cache=True, nogil=True)
def _close_up(first, kept, other, weight):
    """Move the remaining half-edges together, in place: a second copy would be the peak of the memory."""
    for p in range(first.size - 1):
        for k in range(kept[p + 1] - kept[p]):
            other[kept[p] + k], weight[kept[p] + k] = other[first[p] + k], weight[first[p] + k]


@numba.njit(parallel=True, cache=True, nogil=True)
def _degrees_upwards(owned, begin, pixels, first, neighbour, weight, group, factor):
    """Count the groups above each that edges lead to."""
    degree = np.empty(owned[-1], np.int32)
    for share in numba.prange(owned.size - 1):
        above, sums = np.empty(0, np.int32), np.empty(0, np.float32)
        for g in range(owned[share], owned[share + 1]):
            own = pixels[begin[g] : begin[g + 1]]
            above, sums = _with_room(above, sums, own, first)
            degree[g] = _edges_upwards(g, own, first, neighbour, weight, group, factor, above, sums)
    return degree


@numba.njit(parallel=True, cache=True, nogil=True)
def _between_groups(owned, at, begin, pixels, first, neighbour, weight, group, factor):
    """List the edges between groups, each once, at its lower group: both groups, and the weight."""
    tail = np.empty(at[-1], np.int32)
    head, merged = np.empty(at[-1], np.int32), np.empty(at[-1], np.float32)
    for share in numba.prange(owned.size - 1):
        above, sums = np.empty(0, np.int32), np.empty(0, np.float32)
        for g in range(owned[share], owned[share + 1]):
            own = pixels[begin[g] : begin[g + 1]]
            above, sums = _with_room(above, sums, own, first)
            count = _edges_upwards(g, own, first, neighbour, weight, group, factor, above, sums)
            for k in range(count):
                tail[at[g] + k], head[at[g] + k], merged[at[g] + k] = g, above[k], sums[k]
    return tail, head, merged


@numba.njit(cache=True, nogil=True)
def _with_room(above, sums, pixels, first):
    """Replace the two buffers by larger ones if these pixels have more half-edges."""
    most = 0
    for p in pixels:
        most += first[p + 1] - first[p]
    if most <= above.size:
        return above, sums
    return np.empty(2 * most, np.int32), np.empty(2 * most, np.float32)


@numba.njit(cache=True, nogil=True)
def _edges_upwards(g, pixels, first, neighbour, weight, group, factor, above, sums):
    """List the groups above g that edges lead to, ascending, and their summed weights; returns how many.

    They are summed in the order of the pixels and their edges.
    """
    count = 0
    for p in pixels:
        for k in range(first[p], first[p + 1]):
            other = group[neighbour[k]]
            if other <= g:
                continue
            at = count
            while at > 0 and above[at - 1] > other:
                at -= 1
            if at > 0 and above[at - 1] == other:
                sums[at - 1] += factor * weight[k]
                continue
            for moved in range(count, at, -1):
                above[moved], sums[moved] = above[moved - 1], sums[moved - 1]
            above[at], sums[at] = other, factor * weight[k]
            count += 1
    return count
