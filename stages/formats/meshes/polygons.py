"""Faces of any number of corners, as modelling tools write them, and the triangles that stand for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FEWEST_CORNERS = 3
MOST_FANS = 64  # tried of a face: its time grows with the square of its corners


@dataclass(frozen=True, eq=False)
class Polygons:
    """A mesh as its file has it.

    Attributes
    ----------
    vertices : ndarray, shape (v, 3), float64
    sizes : ndarray, shape (f,), int64
        Corners of each face.
    corners : ndarray, shape (sum of sizes,), int64
        Vertices of the faces, face after face.
    """

    vertices: np.ndarray
    sizes: np.ndarray
    corners: np.ndarray

    @property
    def triangle_count(self) -> int:
        """Number of triangles that these faces are divided into: Σ (corners − 2)."""
        return int((self.sizes - 2).sum())


def triangulate(polygons: Polygons) -> np.ndarray:
    """Divide every face into triangles, as fans around the corner that folds none of them over.

    Where every corner folds one, as in some polygons that are far from convex, the fan that folds least is
    taken: the triangles then overlap, yet none is missing.

    Parameters
    ----------
    polygons : Polygons
        Each face with at least three corners, each corner a vertex.

    Returns
    -------
    ndarray, shape (t, 3), int32
        In the order of the faces; t is `polygons.triangle_count`.
    """
    triangles = np.empty((polygons.triangle_count, 3), np.int32)
    first_corner = np.cumsum(polygons.sizes) - polygons.sizes
    first_triangle = np.cumsum(polygons.sizes - 2) - (polygons.sizes - 2)
    for size in np.unique(polygons.sizes):
        alike = np.flatnonzero(polygons.sizes == size)
        corners = polygons.corners[first_corner[alike, None] + np.arange(size)]
        fans = corners[:, None, :] if size == FEWEST_CORNERS else _fans(polygons.vertices, corners)
        triangles[first_triangle[alike, None] + np.arange(size - 2)] = fans
    return triangles


def _fans(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Triangles (f, n − 2, 3) of faces with n corners each, (f, n)."""
    count, size = corners.shape
    best, flattest = np.zeros((count, size - 2, 3), corners.dtype), np.full(count, -np.inf)
    normal = _newell_normals(vertices[corners])
    for start in range(0, size, -(-size // MOST_FANS)):
        turned = np.roll(corners, -start, axis=1)
        fan = np.stack([np.repeat(turned[:, :1], size - 2, axis=1), turned[:, 1:-1], turned[:, 2:]], axis=2)
        a, b, c = np.moveaxis(vertices[fan], 2, 0)
        least = np.einsum("ftk,fk->ft", np.cross(b - a, c - a), normal).min(axis=1)
        better = least > flattest
        best[better], flattest[better] = fan[better], least[better]
    return best


def _newell_normals(positions: np.ndarray) -> np.ndarray:
    """Normals, not normalised, (f, 3), of faces that need not be flat, (f, n, 3)."""
    relative = positions - positions[:, :1]
    return np.cross(relative, np.roll(relative, -1, axis=1)).sum(axis=1)
