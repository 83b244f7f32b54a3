"""Prolongation from a coarser level of `PrimalDual` to a finer one: values of pixels, duals of edges."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.solvers.kernels.arrays_in_files import in_file
from stages.solvers.kernels.sliced_ellpack import Slices, held_at
from stages.solvers.primal_dual.problem import Steps
from stages.solvers.primal_dual.sliced_graph import SlicedGraph


@dataclass(frozen=True, eq=False)
class CoarseState:
    """State of `PrimalDual` that initialises the next finer level; arrays are shared, not copied."""

    slices: Slices
    graph: SlicedGraph
    albedo: np.ndarray
    light: np.ndarray
    edge_dual: np.ndarray
    data_dual: np.ndarray
    multiplier: np.ndarray
    steps: Steps
    free_light: bool

    def in_file(self, folder: Path | None) -> CoarseState:
        """Move what is of every pixel or edge to a file in a folder; see `arrays_in_files`."""
        graph = self.graph
        neighbour, weight, *rest = in_file(
            [graph.neighbour, graph.weight, self.albedo, self.edge_dual, self.data_dual], folder
        )
        albedo, edge_dual, data_dual = rest
        graph = replace(graph, neighbour=neighbour, weight=weight)
        return replace(self, graph=graph, albedo=albedo, edge_dual=edge_dual, data_dual=data_dual)


@numba.njit(parallel=True, cache=True, nogil=True)
def prolong_pixels(group, coarse, fine):
    """Copy three channels of every pixel from its group; `group` is the group's place, −1 for no pixel."""
    for share in numba.prange(group.size):
        own, other = np.int64(share), np.int64(group[share])
        if other >= 0:
            for c in range(3):
                fine[held_at(own, c)] = coarse[held_at(other, c)]


@numba.njit(parallel=True, cache=True, nogil=True)
def prolong_edges(group, coarse, fine):
    """Copy the dual of every edge between groups from the coarse edge, found in the rows of its group."""
    first_c, neighbour_c, weight_c, dual_c = coarse
    first, neighbour, weight, dual = fine
    for share in numba.prange(first.size - 1):
        s = np.int64(share)
        for at in range(np.int64(first[s]) * 8, np.int64(first[s + 1]) * 8):
            own, other = np.int64(group[s * 8 + at % 8]), np.int64(group[neighbour[at]])
            if weight[at] == 0 or own == other:
                continue
            for row in range(np.int64(first_c[own // 8]), np.int64(first_c[own // 8 + 1])):
                at_c = row * 8 + own % 8
                if weight_c[at_c] > 0 and np.int64(neighbour_c[at_c]) == other:
                    for c in range(3):
                        dual[held_at(at, c)] = dual_c[held_at(at_c, c)]
                    break
