"""Normals of a mesh at several levels of smoothing, and other values at its vertices, smoothed likewise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from stages.formats.meshes.triangle_meshes import Surface
from stages.solvers.kernels.unit_vectors import as_unit

RING = 6 / 7  # mean squared distance, in edges, of a vertex and its six neighbours


@dataclass(frozen=True, eq=False)
class VertexSmoothing:
    """Repeated averages of values at a mesh's vertices over their neighbours and themselves.

    Attributes
    ----------
    around : csr_array, shape (V, V), float32
        1 for every vertex itself and those that it shares an edge with.
    steps : tuple of int
        How often values of each level are averaged, ascending: 0, 1, and more.
    wider : int
        A band's filter than the band, in averages, either way.
    """

    around: sp.csr_array
    steps: tuple[int, ...]
    wider: int

    @classmethod
    def of(cls, faces: np.ndarray, vertices: int, steps: tuple[int, ...], wider: int = 1) -> VertexSmoothing:
        """Find the neighbours of a mesh's vertices from its faces, (F, 3); further steps than 0 and 1."""
        ends = [faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]
        one, other = np.concatenate([*ends, np.arange(vertices).repeat(2).reshape(-1, 2)]).T
        rows, columns = np.concatenate([one, other]), np.concatenate([other, one])
        ones = np.ones(len(rows), np.float32)
        around = sp.coo_array((ones, (rows, columns)), shape=(vertices, vertices)).tocsr()
        around.data[:] = 1  # an edge has two faces
        return cls(around, (0, 1, *steps), wider)

    def normals(self, normals: np.ndarray) -> list[np.ndarray]:
        """Smooth unit normals, (V, 3): those of every level, unit, float32. Zeros stay zero."""
        levels = [normals.astype(np.float32)]
        for before, after in pairwise(self.steps):
            levels.append(self._repeated(levels[-1], lambda now: as_unit(self.around @ now), after - before))
        return levels

    def band(self, values: np.ndarray, known: np.ndarray, number: int) -> np.ndarray:
        """Select what values, (V,), have between one level and the next: (V,), float32.

        A vertex that is not known, (V,), bool, takes part in no average. What one average takes away is left
        out, also of the first band: no photo is sharper than that.
        """
        least, most = max(self.steps[number] // self.wider, 1), self.steps[number + 1] * self.wider
        own = known.astype(np.float32)
        weight = np.maximum(self.around @ own, 1)

        def once(now: np.ndarray) -> np.ndarray:
            averaged: np.ndarray = (self.around @ np.where(known, now, 0)) / weight
            return averaged

        finer = self._repeated(values.astype(np.float32), once, least)
        return finer - self._repeated(finer, once, most - least)

    def _repeated(
        self, values: np.ndarray, once: Callable[[np.ndarray], np.ndarray], count: int
    ) -> np.ndarray:
        for _ in range(count):
            values = once(values)
        return values


def radii_of(steps: Sequence[int], edge: float) -> list[float]:
    """Compute the radii that so many averages smooth over, and an edge, model units."""
    return [edge * (1 + float(np.sqrt(RING * count))) for count in steps]


def typical_edge(surface: Surface) -> float:
    """Measure the median length of the first edge of faces, model units."""
    ends = surface.vertices[surface.faces[:, :2]]
    return float(np.median(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))
