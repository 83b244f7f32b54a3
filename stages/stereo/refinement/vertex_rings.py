"""Vertices and their neighbours: curvature of values on a mesh, and matrices of its edges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401  # before the first parallel loop


@dataclass(frozen=True, eq=False)
class VertexRings:
    """The neighbours of every vertex, by compressed rows.

    Attributes
    ----------
    first : ndarray, shape (V + 1,), int64
        Begin of each vertex's part of the lists.
    neighbours, edges : ndarray, shape (2 E,), int32
        Neighbouring vertices, and the edges that lead to them.
    edges_of_faces : ndarray, shape (F, 3), int32
        Edges from corner 0 to 1, 1 to 2 and 2 to 0 of each face.
    edge_count : int
    """

    first: np.ndarray
    neighbours: np.ndarray
    edges: np.ndarray
    edges_of_faces: np.ndarray
    edge_count: int

    @classmethod
    def of(cls, faces: np.ndarray, vertices: int) -> VertexRings:
        """Find the neighbours from the faces, (F, 3), of so many vertices."""
        ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2).astype(np.int64)
        low, high = ends.min(axis=1), ends.max(axis=1)
        keys, edge = np.unique(low * vertices + high, return_inverse=True)
        low, high = keys // vertices, keys % vertices
        numbers = np.arange(len(keys))
        rows = np.concatenate([low, high])
        order = np.argsort(rows, kind="stable")
        first = np.zeros(vertices + 1, np.int64)
        np.cumsum(np.bincount(rows, minlength=vertices), out=first[1:])
        neighbours = np.concatenate([high, low])[order].astype(np.int32)
        edges = np.concatenate([numbers, numbers])[order].astype(np.int32)
        return cls(first, neighbours, edges, edge.reshape(-1, 3).astype(np.int32), len(keys))

    def averaged(self, values: np.ndarray) -> np.ndarray:
        """Average values, (V,), over the neighbours of each vertex; its own where it has none."""
        return _averaged(self.first, self.neighbours, values)

    def curvature(self, values: np.ndarray) -> np.ndarray:
        """Subtract from values, (V,), their average over the neighbours: ``L x``."""
        return values - self.averaged(values)

    def transposed_curvature(self, values: np.ndarray) -> np.ndarray:
        """Apply ``Lᵀ`` to values, (V,)."""
        return _transposed_curvature(self.first, self.neighbours, values, values / self._counts)

    @cached_property
    def _counts(self) -> np.ndarray:
        """Count the neighbours of every vertex, (V,); 1 where there are none, which no one gathers."""
        return np.maximum(np.diff(self.first), 1)

    def product(self, diagonal: np.ndarray, of_neighbours: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Multiply values, (V,), by a symmetric matrix: its diagonal, (V,), and of neighbours, (2 E,)."""
        return _product(self.first, self.neighbours, diagonal, of_neighbours, values)

    def squared_curvature(self, weights: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Apply ``Lᵀ W L`` to values, (V,), W of these weights, (V,)."""
        weighted, shared = np.empty_like(values), np.empty_like(values)
        _weigh_curvature(self.first, self.neighbours, weights, values, weighted, shared)
        return _transposed_curvature(self.first, self.neighbours, weighted, shared)

    def squared_curvature_diagonal(self, weights: np.ndarray) -> np.ndarray:
        """Compute the diagonal of ``Lᵀ W L``, W of these weights, (V,)."""
        return _squared_curvature_diagonal(self.first, self.neighbours, weights)


@numba.njit(parallel=True, cache=True, nogil=True)
def _averaged(first, neighbours, values):
    found = np.empty_like(values)
    for v in numba.prange(len(values)):
        begin, end = first[v], first[v + 1]
        total = 0.0
        for k in range(begin, end):
            total += values[neighbours[k]]
        found[v] = total / (end - begin) if end > begin else values[v]
    return found


@numba.njit(parallel=True, cache=True, nogil=True)
def _weigh_curvature(first, neighbours, weights, values, weighted, shared):
    """Compute ``W L x``, and each vertex's share of it over its neighbours."""
    for v in numba.prange(len(values)):
        begin, end = first[v], first[v + 1]
        total = 0.0
        for k in range(begin, end):
            total += values[neighbours[k]]
        count = max(end - begin, 1)
        weighted[v] = weights[v] * (values[v] - total / count) if end > begin else 0.0
        shared[v] = weighted[v] / count


@numba.njit(parallel=True, cache=True, nogil=True)
def _transposed_curvature(first, neighbours, values, shared):
    found = np.empty_like(values)
    for v in numba.prange(len(values)):
        total = values[v] if first[v + 1] > first[v] else 0.0
        for k in range(first[v], first[v + 1]):
            total -= shared[neighbours[k]]
        found[v] = total
    return found


@numba.njit(parallel=True, cache=True, nogil=True)
def _product(first, neighbours, diagonal, of_neighbours, values):
    found = np.empty_like(values)
    for v in numba.prange(len(values)):
        total = diagonal[v] * values[v]
        for k in range(first[v], first[v + 1]):
            total += of_neighbours[k] * values[neighbours[k]]
        found[v] = total
    return found


@numba.njit(parallel=True, cache=True, nogil=True)
def _squared_curvature_diagonal(first, neighbours, weights):
    found = np.empty_like(weights)
    for v in numba.prange(len(weights)):
        total = weights[v] if first[v + 1] > first[v] else 0.0
        for k in range(first[v], first[v + 1]):
            u = neighbours[k]
            total += weights[u] / (first[u + 1] - first[u]) ** 2
        found[v] = total
    return found
