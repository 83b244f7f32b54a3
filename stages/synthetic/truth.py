"""What light does not change in a picture of a painted mesh: albedo, coverage, depth, normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.geometry.rays import RayCaster, Seen
from stages.scene.cameras import Camera
from stages.scene.meshes import Surface


@dataclass(frozen=True, eq=False)
class Truth:
    """True maps of one view.

    Attributes
    ----------
    albedo : ndarray, shape (h, w, 3), float32
        Linear; the mean over each pixel's square, as the renderer's box filter takes it; 0 off the mask.
    mask : ndarray, shape (h, w), bool
        Pixels that lie wholly on the mesh.
    depth : ndarray, shape (h, w), float32
        z at the pixel's centre, model units; 0 where nothing is hit.
    normals : ndarray, shape (h, w, 3), float32
        At the pixel's centre, unit, world axes; 0 where nothing is hit.
    """

    albedo: np.ndarray
    mask: np.ndarray
    depth: np.ndarray
    normals: np.ndarray


class PaintedSurface:
    """A mesh with an albedo per vertex, shape (V, 3), linear, interpolated within faces."""

    def __init__(self, surface: Surface, albedo: np.ndarray):
        self._faces, self._albedo = surface.faces, albedo
        self._rays = RayCaster(surface)

    def truth(self, camera: Camera, samples_per_side: int = 4) -> Truth:
        """True maps; albedo and mask from a grid of `samples_per_side`² rays in every pixel."""
        n = samples_per_side
        fine = self._rays.see(camera.scaled(camera.width * n, camera.height * n))
        cells = (camera.height, n, camera.width, n)
        mask = fine.mask.reshape(cells).all(axis=(1, 3))
        albedo = self._albedo_at(fine).reshape(*cells, 3).mean(axis=(1, 3)) * mask[..., None]
        centres = self._rays.see(camera)
        return Truth(albedo.astype(np.float32), mask, centres.depth, centres.normals)

    def _albedo_at(self, seen: Seen) -> np.ndarray:
        """Albedo of the surface behind each ray, shape (h, w, 3), float32; 0 where there is none."""
        albedo = np.zeros((*seen.mask.shape, 3), np.float32)
        corners = self._albedo[self._faces[seen.triangles[seen.mask]]]
        u, v = seen.barycentric[seen.mask].T
        albedo[seen.mask] = np.einsum("nk,nkc->nc", np.stack([1 - u - v, u, v], axis=-1), corners)
        return albedo
