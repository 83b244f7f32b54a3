"""Triangle meshes and point clouds on disk: read whole or refused, written through checked streams."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import open3d as o3d

from pipeline import UserError
from stages.formats.colour.srgb import linear_from_srgb, srgb_from_linear
from stages.formats.meshes.ply import read_ply, write_ply
from stages.formats.meshes.polygons import Polygons, triangulate
from stages.scene.cameras import FARTHEST

COLOURS = ("red", "green", "blue")


@dataclass(frozen=True)
class Surface:
    """A triangle mesh: vertices (v, 3) float64, world axes; faces (f, 3) int32, right hand outwards."""

    vertices: np.ndarray
    faces: np.ndarray

    @property
    def diagonal(self) -> float:
        """Of the box around all vertices along the world's axes, model units."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))


def read_mesh(path: Path) -> Surface:
    """Read a PLY, as all stages hand it on; faces of more than three corners are divided into triangles.

    Raises
    ------
    UserError
        It cannot be read, was cut off, has no faces, or holds a vertex that is not finite or a face whose
        vertex is missing.
    """
    return from_polygons(path, read_ply(path).polygons())


def from_polygons(path: Path, polygons: Polygons) -> Surface:
    """Check the faces that a file holds, and divide them into triangles.

    Raises
    ------
    UserError
        There are none, a vertex is not finite or beyond `FARTHEST`, or a face names one that is not there.
    """
    if not len(polygons.sizes):
        raise UserError(f"{path} gave no faces; expected a mesh as PLY, OBJ, STL, OFF or GLB.")
    if not np.isfinite(polygons.vertices).all():
        raise UserError(f"{path} has vertices that are not finite numbers; export the mesh again.")
    if (farthest := float(np.abs(polygons.vertices).max(initial=0))) > FARTHEST:
        raise UserError(
            f"{path} has a vertex with a coordinate of {farthest:g}; expected at most {FARTHEST:g}, for rays "
            "are cast in single precision. Scale the mesh and its cameras down."
        )
    first, last = polygons.corners.min(), polygons.corners.max()
    if first < 0 or last >= len(polygons.vertices):
        raise UserError(
            f"{path} has faces that name vertices {first} to {last}; expected 0 to "
            f"{len(polygons.vertices) - 1}, for it holds no others. Export the mesh again."
        )
    return Surface(polygons.vertices, triangulate(polygons))


def write_mesh(path: Path, surface: Surface, albedo: np.ndarray | None = None) -> None:
    """Write a binary PLY; with linear albedo, (v, 3), as vertex colours that `read_vertex_colours` reads."""
    columns = dict(zip("xyz", surface.vertices.T.astype("f8"), strict=True))
    if albedo is not None:
        colours = np.rint(srgb_from_linear(albedo) * 255).astype(np.uint8)
        columns |= dict(zip(COLOURS, colours.T, strict=True))
    write_ply(path, columns, surface.faces)


def joined(surface: Surface) -> tuple[Surface, np.ndarray]:
    """Join vertices that lie on one another, as in STL or at the seams of a texture.

    Returns
    -------
    tuple of Surface, and ndarray, shape (V,)
        The surface itself where there are none; and of each of its vertices, which one that is there.
    """
    positions, number = np.unique(surface.vertices, axis=0, return_inverse=True)
    if len(positions) == len(surface.vertices):
        return surface, np.arange(len(positions))
    number = number.reshape(-1)
    return Surface(positions, number[surface.faces].astype(np.int32)), number


def without_strays(surface: Surface) -> Surface:
    """Drop the vertices that no face has: they are no surface, but would count for its size."""
    return from_open3d(to_open3d(surface).remove_unreferenced_vertices())


def to_open3d(surface: Surface) -> o3d.geometry.TriangleMesh:
    """Convert a mesh to open3d's."""
    return o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(surface.vertices), o3d.utility.Vector3iVector(surface.faces)
    )


def from_open3d(mesh: o3d.geometry.TriangleMesh) -> Surface:
    """Convert a mesh from open3d's."""
    return Surface(np.asarray(mesh.vertices).copy(), np.asarray(mesh.triangles, np.int32).copy())


def read_vertex_colours(path: Path) -> np.ndarray:
    """Read vertex colours of a PLY as linear albedo, (v, 3) float32; files hold them as sRGB.

    Raises
    ------
    UserError
        It is no PLY, or has none.
    """
    file = read_ply(path)
    colours = file.columns(*COLOURS)
    if colours is None:
        raise UserError(f"{path} has no vertex colours; expected a PLY with red, green and blue per vertex.")
    kind = file.vertex["red"].dtype
    white = np.iinfo(kind).max if np.issubdtype(kind, np.integer) else 1
    return linear_from_srgb(colours / white).astype(np.float32)
