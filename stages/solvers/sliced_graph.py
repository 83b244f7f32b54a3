"""The graph of pixels as eight of them see it at a time: what the solver's loops walk along."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from stages.solvers.half_edges import HalfEdges
from stages.solvers.lanes import COUNT
from stages.solvers.slices import Slices


@dataclass(frozen=True, eq=False)
class SlicedGraph:
    """Half-edges in rows of eight, one per pixel of a slice; short pixels are filled up with weight 0.

    Attributes
    ----------
    first : ndarray, shape (S + 1,), uint64
        The rows of slice s are ``first[s]:first[s + 1]``.
    neighbour : ndarray, shape (R · 8,), uint32
        Where the neighbour's first channel lies in a flattened (S, 3, 8) array; the others follow at 8, 16.
    weight : ndarray, shape (R · 8,), float32
    total : ndarray, shape (S · 8,), float32
        Σ w of a pixel's half-edges; at least `NEARLY_FREE`.
    """

    first: np.ndarray
    neighbour: np.ndarray
    weight: np.ndarray
    total: np.ndarray


NEARLY_FREE = 1e-6  # a pixel without neighbours: nothing holds it back


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
def _arrange(start, other, weight, places, first, neighbour, row_weight, total):
    for p in range(places.size):
        slice_, lane = places[p] // COUNT, places[p] % COUNT
        own = 0.0
        for k in range(start[p], start[p + 1]):
            q = places[other[k]]
            at = (first[slice_] + k - start[p]) * COUNT + lane
            neighbour[at] = (q // COUNT) * (3 * COUNT) + q % COUNT
            row_weight[at] = weight[k]
            own += weight[k]
        total[places[p]] = max(own, NEARLY_FREE)
