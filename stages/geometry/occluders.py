"""Rays between points of a mesh: occlusion of the sky, nearest faces."""

from __future__ import annotations

import numpy as np
import open3d as o3d

from stages.formats.meshes.triangle_meshes import Surface


class Occluders:
    """A mesh made ready for rays between its own points, float32, relative to the mean of its vertices."""

    def __init__(self, surface: Surface, threads: int = 0) -> None:
        self._faces, self._threads = surface.faces, threads
        self._scene, self.origin = scene_of(surface, threads)

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cast rays and find what each meets first.

        Parameters
        ----------
        origins : ndarray, shape (r, 3), float32
            Relative to `origin`.
        directions : ndarray, shape (r, 3), float32
            Unit.

        Returns
        -------
        tuple of ndarray, shape (r,), int32, and ndarray, shape (r,), bool
            The vertex nearest to what was met, −1 for nothing; whether it was met from behind.
        """
        packed = np.concatenate([origins, directions], axis=1)
        found = self._scene.cast_rays(o3d.core.Tensor.from_numpy(packed), nthreads=self._threads)
        met = np.isfinite(found["t_hit"].numpy())
        vertex, behind = np.full(len(met), -1, np.int32), np.zeros(len(met), bool)
        u, v = found["primitive_uvs"].numpy()[met].T
        corner = np.argmax(np.stack([1 - u - v, u, v]), axis=0)
        vertex[met] = self._faces[found["primitive_ids"].numpy()[met], corner]
        facing = np.einsum("rk,rk->r", found["primitive_normals"].numpy()[met], directions[met])
        behind[met] = facing > 0
        return vertex, behind

    def blocked(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Test whether rays, as for `cast`, meet anything at all: shape (r,), bool."""
        packed = np.concatenate([origins, directions], axis=1)
        return self._scene.test_occlusions(o3d.core.Tensor.from_numpy(packed), nthreads=self._threads).numpy()


def scene_of(surface: Surface, threads: int = 0) -> tuple[o3d.t.geometry.RaycastingScene, np.ndarray]:
    """Build open3d's scene of a surface; return it and the origin, (3,), of its float32 coordinates.

    The mean of the vertices: a georeferenced model with coordinates in the millions keeps its millimetres.
    """
    origin = surface.vertices.mean(axis=0)
    scene = o3d.t.geometry.RaycastingScene(nthreads=threads)
    scene.add_triangles(
        o3d.core.Tensor.from_numpy((surface.vertices - origin).astype(np.float32)),
        o3d.core.Tensor.from_numpy(surface.faces.astype(np.uint32)),
    )
    return scene, origin


def first_faces(
    scene: o3d.t.geometry.RaycastingScene, rays: np.ndarray, threads: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Find the face that each ray meets first.

    Parameters
    ----------
    scene : RaycastingScene
    rays : ndarray, shape (..., 6), float32
        Origin, relative to the scene's, and direction.
    threads : int
        0: all.

    Returns
    -------
    tuple of ndarray, shape (...), uint32, and ndarray, shape (..., 2), float32
        The face, `rays.NO_TRIANGLE` where there is none, and barycentric coordinates of its second and third
        corner.
    """
    hits = scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=threads)
    return hits["primitive_ids"].numpy(), hits["primitive_uvs"].numpy()


def nearest_faces(
    scene: o3d.t.geometry.RaycastingScene, points: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the face of a surface that is nearest to each point.

    Parameters
    ----------
    scene : RaycastingScene
        Of the surface: `scene_of`.
    points : ndarray, shape (n, 3), float32
        Relative to the scene's origin.
    normals : ndarray, shape (n, 3)

    Returns
    -------
    faces : ndarray, shape (n,), uint32
    weights : ndarray, shape (n, 3), float32
        Of the face's corners at its point that is nearest; they sum to 1.
    facing : ndarray, shape (n,), bool
        Whether the face is turned the way of the normal.
    """
    nearest = scene.compute_closest_points(o3d.core.Tensor.from_numpy(points))
    u, v = nearest["primitive_uvs"].numpy().T
    weights = np.clip(np.stack([1 - u - v, u, v], axis=1), 0, 1)
    facing = np.einsum("vk,vk->v", nearest["primitive_normals"].numpy(), normals) >= 0
    return nearest["primitive_ids"].numpy().copy(), weights / weights.sum(axis=1, keepdims=True), facing


def distances_to(surface: Surface, points: np.ndarray) -> np.ndarray:
    """Measure the unsigned distance of points, (n, 3), to a surface: shape (n,), float32, model units."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(surface.vertices.astype(np.float32)),
        o3d.core.Tensor.from_numpy(surface.faces.astype(np.uint32)),
    )
    packed = np.ascontiguousarray(points, np.float32)
    return scene.compute_distance(o3d.core.Tensor.from_numpy(packed)).numpy()
