"""What light does not change in a picture of a painted mesh: albedo, coverage, depth, normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.rays import RayCaster, Seen
from stages.scene.cameras import Camera


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
    parts : ndarray, shape (h, w), uint8
        1 + index of the part of uniform albedo that the whole pixel lies on; 0 on seams and elsewhere.
    """

    albedo: np.ndarray
    mask: np.ndarray
    depth: np.ndarray
    normals: np.ndarray
    parts: np.ndarray


class PaintedSurface:
    """A mesh with an albedo per vertex, linear, interpolated within faces.

    Parameters
    ----------
    surface : Surface
    albedo : ndarray, shape (V, 3)
    uniform : ndarray, shape (V,), uint8, optional
        1 + index of the part of uniform albedo that a vertex belongs to; 0 for none.
    """

    def __init__(self, surface: Surface, albedo: np.ndarray, uniform: np.ndarray | None = None):
        self._faces, self._albedo = surface.faces, albedo
        self._face_parts = np.zeros(len(surface.faces), np.uint8)
        if uniform is not None:
            corners = uniform[surface.faces]
            self._face_parts = np.where((corners == corners[:, :1]).all(axis=1), corners[:, 0], 0)
        self._rays = RayCaster(surface)

    def truth(self, camera: Camera, samples_per_side: int = 4) -> Truth:
        """True maps; albedo and mask from a grid of `samples_per_side`² rays in every pixel."""
        n = samples_per_side
        fine = self._rays.see(camera.scaled(camera.width * n, camera.height * n))
        cells = (camera.height, n, camera.width, n)
        mask = np.all(fine.mask.reshape(cells), axis=(1, 3))
        albedo = self._albedo_at(fine).reshape(*cells, 3).mean(axis=(1, 3)) * mask[..., None]
        centres = self._rays.see(camera)
        parts = np.zeros(fine.mask.shape, np.uint8)
        parts[fine.mask] = self._face_parts[fine.triangles[fine.mask]]
        parts = _whole_pixels(parts, n)
        return Truth(albedo.astype(np.float32), mask, centres.depth, centres.normals, parts)

    def _albedo_at(self, seen: Seen) -> np.ndarray:
        """Albedo of the surface behind each ray, shape (h, w, 3), float32; 0 where there is none."""
        albedo = np.zeros((*seen.mask.shape, 3), np.float32)
        corners = self._albedo[self._faces[seen.triangles[seen.mask]]]
        u, v = seen.barycentric[seen.mask].T
        albedo[seen.mask] = np.einsum("nk,nkc->nc", np.stack([1 - u - v, u, v], axis=-1), corners)
        return albedo


def _whole_pixels(parts: np.ndarray, n: int) -> np.ndarray:
    """The part that all rays of a pixel and those next to it agree on, else 0; (h · n, w · n) to (h, w).

    The outermost rays lie half a step inside their pixel: the next ones, outside, vouch for the rest of it.
    """
    lowest, highest = minimum_filter(parts, 3), maximum_filter(parts, 3)
    agreed = np.where(lowest == highest, parts, 0)
    cells = (parts.shape[0] // n, n, parts.shape[1] // n, n)
    lowest, highest = agreed.reshape(cells).min(axis=(1, 3)), agreed.reshape(cells).max(axis=(1, 3))
    return np.where(lowest == highest, lowest, 0).astype(np.uint8)
