"""Triangle meshes and point clouds on disk, through open3d."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import open3d as o3d

from pipeline import UserError
from stages.scene.colour import linear_from_srgb, srgb_from_linear

# Each holds the whole mesh in one file; GLTF keeps its vertices in another, which nobody would digest.
MESHES = (".ply", ".obj", ".stl", ".off", ".glb")


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
    """Read PLY, OBJ, STL, OFF, GLB.

    Raises
    ------
    UserError
        It is of another kind, cannot be read, has no triangles, or holds a vertex that is not finite or a
        triangle whose vertex is missing.
    """
    if path.suffix.lower() not in MESHES:
        raise UserError(f"{path} is of an unknown kind; expected PLY, OBJ, STL, OFF or GLB: convert it.")
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        surface = from_open3d(o3d.io.read_triangle_mesh(str(path)))
    if not len(surface.faces):
        raise UserError(f"{path} gave no triangles; expected a mesh as PLY, OBJ, STL, OFF or GLB.")
    if not np.isfinite(surface.vertices).all():
        raise UserError(f"{path} has vertices that are not finite numbers; export the mesh again.")
    first, last = surface.faces.min(), surface.faces.max()
    if first < 0 or last >= len(surface.vertices):
        raise UserError(
            f"{path} has triangles that name vertices {first} to {last}; expected 0 to "
            f"{len(surface.vertices) - 1}, for it holds no others. Export the mesh again."
        )
    return surface


def write_mesh(path: Path, surface: Surface, albedo: np.ndarray | None = None) -> None:
    """Write a binary PLY; with linear albedo, (v, 3), as vertex colours that `read_vertex_colours` reads."""
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh = to_open3d(surface)
    if albedo is not None:
        mesh.vertex_colors = o3d.utility.Vector3dVector(srgb_from_linear(albedo))
    if not o3d.io.write_triangle_mesh(str(path), mesh):
        raise OSError(f"{path} could not be written")


def read_points(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Positions and normals of a PLY point cloud, each (n, 3) float64, without points that are not finite."""
    cloud = o3d.io.read_point_cloud(str(path))
    x_in_world, normals = np.asarray(cloud.points).copy(), np.asarray(cloud.normals).copy()
    finite = np.isfinite(x_in_world).all(axis=1) & np.isfinite(normals).all(axis=1)
    return x_in_world[finite], normals[finite]


def joined(surface: Surface) -> tuple[Surface, np.ndarray]:
    """One vertex where several lie on one another, as in STL or at the seams of a texture.

    Returns
    -------
    tuple of Surface, and ndarray, shape (V,)
        The surface itself where there are none; and of each of its vertices, which one that is there.
    """
    places, number = np.unique(surface.vertices, axis=0, return_inverse=True)
    if len(places) == len(surface.vertices):
        return surface, np.arange(len(places))
    number = number.reshape(-1)
    return Surface(places, number[surface.faces].astype(np.int32)), number


def without_strays(surface: Surface) -> Surface:
    """Without the vertices that no face has: they are no surface, but would count for its size."""
    return from_open3d(to_open3d(surface).remove_unreferenced_vertices())


def to_open3d(surface: Surface) -> o3d.geometry.TriangleMesh:
    """The same mesh for open3d."""
    return o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(surface.vertices), o3d.utility.Vector3iVector(surface.faces)
    )


def from_open3d(mesh: o3d.geometry.TriangleMesh) -> Surface:
    """The same mesh from open3d."""
    return Surface(np.asarray(mesh.vertices).copy(), np.asarray(mesh.triangles, np.int32).copy())


def read_vertex_colours(path: Path) -> np.ndarray:
    """Vertex colours of a mesh as linear albedo, (v, 3) float32; files hold them as sRGB.

    Raises
    ------
    UserError
        The mesh has none.
    """
    colours = np.asarray(o3d.io.read_triangle_mesh(str(path)).vertex_colors)
    if not len(colours):
        raise UserError(f"{path} has no vertex colours; expected a PLY with red, green and blue per vertex.")
    return linear_from_srgb(colours).astype(np.float32)
