"""A weighted graph over pixels as every pixel sees it: its neighbours, half an edge on either side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp


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


def half_edges(operators: list[tuple[sp.csr_array, float]]) -> HalfEdges:
    """Build the graph of a sum of weighted total variations.

    Parameters
    ----------
    operators : list of (csr_array of shape (·, N), float)
        Differences, every row one −1 and one +1, and what their absolute values weigh.
    """
    size = operators[0][0].shape[1]
    ends = [operator.indices.reshape(-1, 2) for operator, _ in operators]
    weights = np.repeat([weight for _, weight in operators], [len(pairs) for pairs in ends])
    pairs = np.concatenate(ends)
    return from_edges(size, pairs[:, 0], pairs[:, 1], weights)


def from_edges(size: int, tail: np.ndarray, head: np.ndarray, weight: np.ndarray) -> HalfEdges:
    """Build the graph from its edges, (E,) each; weights of edges between the same two pixels add up.

    They add up once, in whatever order, for both ends: the two weigh the same to the last bit. Edges that
    weigh nothing are dropped.
    """
    ends = np.minimum(tail, head), np.maximum(tail, head)
    once = sp.csr_array((weight.astype(np.float32), ends), shape=(size, size))  # adds up what meets
    matrix = once + once.T
    matrix.sort_indices()
    return HalfEdges(
        matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32), matrix.data.astype(np.float32)
    )


def aggregated(graph: HalfEdges, group: np.ndarray, count: int) -> HalfEdges:
    """The graph between groups of pixels: weights add up, edges inside a group vanish.

    Parameters
    ----------
    group : ndarray, shape (N,), integer
        Group of every pixel, below `count`.
    """
    owner = np.repeat(np.arange(graph.size), np.diff(graph.first))
    a, b = group[owner], group[graph.neighbour]
    once = a < b
    return from_edges(count, a[once], b[once], graph.weight[once])
