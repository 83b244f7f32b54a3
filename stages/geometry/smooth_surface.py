"""The smooth surface that the facets of a mesh stand for: its points, and rays that leave it."""

from __future__ import annotations

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.occluders import Occluders
from stages.geometry.rays import vertex_normals

LIFT = 1e-5  # of points off the surface, in diagonals of the mesh: single precision


class SmoothSurface:
    """A mesh whose own points are lit: facets of a smooth surface do not shade each other.

    Attributes
    ----------
    origin : ndarray, shape (3,)
        World, of all other coordinates.
    """

    def __init__(self, mesh: Surface, threads: int = 0) -> None:
        self._occluders = Occluders(mesh, threads)
        self.origin = self._occluders.origin
        self._lift = np.float32(LIFT * mesh.diagonal)
        self._faces = mesh.faces
        self._vertices = (mesh.vertices - self.origin).astype(np.float32)
        self._normals = vertex_normals(mesh.vertices, mesh.faces)

    def points(self, faces: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Interpolate points, slightly off the smooth surface, relative to the origin.

        Parameters
        ----------
        faces : ndarray, shape (n,)
        barycentric : ndarray, shape (n, 2)
            (u, v): the facet's point is (1 − u − v) a + u b + v c.

        Returns
        -------
        ndarray, shape (n, 3), float32

        Notes
        -----
        The planes that touch the corners, where they are above the facet, are interpolated (Hanika, Hacking
        the Shadow Terminator, Ray Tracing Gems II, 2021). Lifting all points as far would shift shadows.
        """
        corners, normals = self._vertices[self._faces[faces]], self._normals[self._faces[faces]]
        shares = np.column_stack([1 - barycentric.sum(axis=1), barycentric]).astype(np.float32)
        points = np.einsum("nc,nck->nk", shares, corners)
        above = np.maximum(np.einsum("nck,nck->nc", corners - points[:, None], normals), 0)
        return points + np.einsum("nc,nck->nk", shares * (above + self._lift), normals)

    def blocked(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Test whether rays relative to the origin, (r, 3) float32 each, meet the mesh: (r,), bool."""
        return self._occluders.blocked(origins, directions)
