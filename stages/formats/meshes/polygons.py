"""Faces of any number of corners, as modelling tools write them: their triangles, and their UV maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline import UserError

FEWEST_CORNERS = 3
MOST_FANS = 64  # tried of a face: its time grows with the square of its corners
NO_UV = -1
FARTHEST_UV = 1e6  # beyond it, single precision leaves no place inside a texture
NAMELESS = "material"


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


@dataclass(frozen=True, eq=False)
class UVMap:
    """Texture coordinates of a mesh's corners, and the materials of its faces.

    Attributes
    ----------
    uv : ndarray, shape (n, 2), float64
        In the file's order and orientation.
    corners : ndarray, shape (sum of sizes,), int64
        Row of `uv` of each corner of `Polygons`, `NO_UV` where it has none.
    material : ndarray, shape (f,), int64
        Of each face.
    materials : tuple of str
        Names.
    v_upwards : bool
        Whether v points up in the image, as OBJ and PLY have it, or down, as glTF.
    """

    uv: np.ndarray
    corners: np.ndarray
    material: np.ndarray
    materials: tuple[str, ...]
    v_upwards: bool

    def with_v(self, upwards: bool) -> np.ndarray:
        """Return the coordinates with v pointing up or down; to the bit as in the file where it has it so."""
        return self.uv if upwards == self.v_upwards else np.column_stack([self.uv[:, 0], 1 - self.uv[:, 1]])


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


def checked_uv_map(path: Path, polygons: Polygons, found: UVMap) -> UVMap | None:
    """Check the UV map of a file; None where no face has one.

    Raises
    ------
    UserError
        Some faces have texture coordinates and others have none, a coordinate is not finite or beyond
        `FARTHEST_UV`, or a corner names one that is not there.
    """
    without = found.corners == NO_UV
    if without.all():
        return None
    if without.any():
        bare = np.unique(np.repeat(np.arange(len(polygons.sizes)), polygons.sizes)[without])
        raise UserError(
            f"{path} has no texture coordinates on {len(bare)} of its {len(polygons.sizes)} faces (the first "
            f"is number {bare[0]}); expected them on all or on none. Unwrap the rest, or set "
            "texture.given_uv.keep=false for new charts."
        )
    if found.corners.min() < 0 or found.corners.max() >= len(found.uv):
        raise UserError(
            f"{path} has corners that name texture coordinates {found.corners.min()} to "
            f"{found.corners.max()}; expected 0 to {len(found.uv) - 1}. Export the mesh again."
        )
    used = found.uv[found.corners]
    if not (np.abs(used) <= FARTHEST_UV).all():
        raise UserError(
            f"{path} has texture coordinates that are not finite, or beyond {FARTHEST_UV:g}; expected "
            "0 to 1, or a few tiles more. Unwrap the mesh again, or set texture.given_uv.keep=false."
        )
    return found


def material_numbers(names: list[str]) -> tuple[np.ndarray, tuple[str, ...]]:
    """Number materials in the order in which faces first name them.

    Parameters
    ----------
    names : list of str
        Of each face; empty where it has none.
    """
    number: dict[str, int] = {}
    material = np.array([number.setdefault(name or NAMELESS, len(number)) for name in names], np.int64)
    return material, tuple(number)


def distinct(names: Sequence[str], key: Callable[[str], str] = str) -> list[str]:
    """Number the names that repeat an earlier one: "wood", "wood_2"; they are compared by a key."""
    found: dict[str, str] = {}
    for name in names:
        own, number = name, 1
        while key(own) in found:
            number += 1
            own = f"{name}_{number}"
        found[key(own)] = own
    return list(found.values())
