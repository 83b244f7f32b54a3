"""Cast every pixel's ray onto the mesh: depth, normals, triangles, barycentric coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
import open3d as o3d

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.occluders import scene_of
from stages.scene.cameras import Camera, rays_in_world
from stages.solvers.kernels.unit_vectors import as_unit

NO_TRIANGLE = np.uint32(0xFFFFFFFF)


@dataclass(frozen=True)
class Hits:
    """Where the rays of one view's pixel centres meet the mesh.

    Attributes
    ----------
    depth : ndarray, shape (h, w), float32
        z, model units; 0 where nothing is hit.
    mask : ndarray, shape (h, w), bool
        Where the mesh is hit.
    triangles : ndarray, shape (h, w), uint32
        Face behind each pixel, `NO_TRIANGLE` where none.
    barycentric : ndarray, shape (h, w, 2), float32
        (u, v): the point is (1 − u − v) a + u b + v c.
    behind : ndarray, shape (h, w), bool
        Where a face is hit from its back.
    """

    depth: np.ndarray
    mask: np.ndarray
    triangles: np.ndarray
    barycentric: np.ndarray
    behind: np.ndarray


@dataclass(frozen=True)
class Seen(Hits):
    """What one view sees of the mesh: Ω, before the user's own mask, is `mask`.

    Attributes
    ----------
    normals : ndarray, shape (h, w, 3), float32
        Unit, world axes, towards the camera; 0 where nothing is hit.
    """

    normals: np.ndarray


class RayCaster:
    """A mesh made ready for rays.

    Vertices are stored relative to their mean, for the rays run in float32: a georeferenced model with
    coordinates in the millions keeps its millimetres.
    """

    def __init__(self, surface: Surface) -> None:
        self._scene, self._origin = scene_of(surface)
        self._surface = surface

    @cached_property
    def _vertex_normals(self) -> np.ndarray:
        return vertex_normals(self._surface.vertices - self._origin, self._surface.faces)

    def hits(self, camera: Camera, threads: int = 0) -> Hits:
        """Cast the rays of all pixel centres of one view."""
        rays = rays_in_world(camera)
        origins = np.broadcast_to(camera.centre_in_world - self._origin, rays.shape)
        packed = np.concatenate([origins, rays], axis=-1).astype(np.float32)
        hit = self._scene.cast_rays(o3d.core.Tensor.from_numpy(packed), nthreads=threads)
        distance = hit["t_hit"].numpy()
        mask = np.isfinite(distance)  # rays have z = 1 in the camera: the distance is z
        triangles, barycentric = hit["primitive_ids"].numpy(), hit["primitive_uvs"].numpy()
        behind = mask & (np.einsum("hwk,hwk->hw", hit["primitive_normals"].numpy(), rays) > 0)
        return Hits(np.where(mask, distance, 0), mask, triangles, barycentric * mask[..., None], behind)

    def see(self, camera: Camera, threads: int = 0) -> Seen:
        """Cast them, and interpolate the mesh's normals where they meet it. Memory: 130 bytes per pixel."""
        hits = self.hits(camera, threads)
        mask = hits.mask
        normals = np.zeros((*mask.shape, 3), np.float32)
        normals[mask] = self._normals(hits.triangles[mask], hits.barycentric[mask], hits.behind[mask])
        return Seen(hits.depth, mask, hits.triangles, hits.barycentric, hits.behind, normals)

    def _normals(self, triangles: np.ndarray, barycentric: np.ndarray, behind: np.ndarray) -> np.ndarray:
        """Interpolated vertex normals, turned by the *face's* side: near silhouettes they may lean away."""
        u, v = barycentric[:, :1], barycentric[:, 1:]
        corners = self._vertex_normals[self._surface.faces[triangles]]
        smooth = (1 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2]
        smooth[behind] *= -1
        return as_unit(smooth)


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute normals of faces, twice their area long, shape (f, 3)."""
    return _face_normals(vertices, faces)


@numba.njit(cache=True, nogil=True)
def _face_normals(vertices, faces):
    """Loop over faces: a cross product of numpy takes twenty times as long."""
    found = np.empty((len(faces), 3), vertices.dtype)
    for face in range(len(faces)):
        a, b, c = faces[face]
        for axis in range(3):
            one, two = (axis + 1) % 3, (axis + 2) % 3
            found[face, axis] = (vertices[b, one] - vertices[a, one]) * (
                vertices[c, two] - vertices[a, two]
            ) - (vertices[b, two] - vertices[a, two]) * (vertices[c, one] - vertices[a, one])
    return found


def summed_at_vertices(of_faces: np.ndarray, faces: np.ndarray, vertices: int) -> np.ndarray:
    """Sum up vectors of faces, (f, 3), at their corners, shape (v, 3), float64."""
    return _summed_at_vertices(of_faces, faces, vertices)


@numba.njit(cache=True, nogil=True)
def _summed_at_vertices(of_faces, faces, vertices):
    found = np.zeros((vertices, 3))
    for face in range(len(faces)):
        for corner in range(3):
            for axis in range(3):
                found[faces[face, corner], axis] += of_faces[face, axis]
    return found


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute area-weighted unit normals, shape (v, 3) float32; zero at a vertex without area around it."""
    summed = summed_at_vertices(face_normals(vertices, faces), faces, len(vertices))
    return as_unit(summed).astype(np.float32)
