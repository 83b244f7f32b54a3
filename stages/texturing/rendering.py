"""Textured surface as a camera sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.rays import RayCaster
from stages.scene.cameras import Camera, back_project, xy_for_integer_centres


@dataclass(frozen=True, eq=False)
class TexturedView:
    """What a camera sees of a textured surface.

    Attributes
    ----------
    mask : ndarray, shape (h, w), bool
        Where it sees surface: n pixels.
    depth : ndarray, shape (h, w), float32
        z, model units; 0 elsewhere.
    texture : ndarray, shape (n, c), float32
    points : ndarray, shape (n, 3), float64
        World axes.
    normals : ndarray, shape (n, 3), float32
        Unit, world axes, towards the camera.
    """

    mask: np.ndarray
    depth: np.ndarray
    texture: np.ndarray
    points: np.ndarray
    normals: np.ndarray


class TexturedSurface:
    """A mesh with an atlas, made ready for rays.

    Parameters
    ----------
    surface : Surface
        V vertices.
    uv : ndarray, shape (V, 2)
        In [0, 1]; v downwards, as rows of the atlas.
    atlas : ndarray, shape (s, s, c), float32
    """

    def __init__(self, surface: Surface, uv: np.ndarray, atlas: np.ndarray) -> None:
        self._caster = RayCaster(surface)
        self._faces, self._uv, self._atlas = surface.faces, uv, atlas

    def seen_by(self, camera: Camera, threads: int = 0) -> TexturedView:
        """Look up the texture at the centres of a camera's pixels, bilinearly between texels."""
        seen = self._caster.see(camera, threads)
        mask = seen.mask
        corners = self._uv[self._faces[seen.triangles[mask]]]
        u, v = seen.barycentric[mask, :1], seen.barycentric[mask, 1:]
        uv = (1 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2]
        return TexturedView(
            mask,
            seen.depth,
            texture_at(self._atlas, uv),
            back_project(camera, seen.depth)[mask],
            seen.normals[mask],
        )


def texture_at(atlas: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Look up an atlas, (s, s, c), bilinearly at coordinates (..., 2) in [0, 1], v downwards: (..., c)."""
    column, row = np.moveaxis(xy_for_integer_centres(uv * len(atlas)), -1, 0)
    channels = np.moveaxis(atlas, -1, 0)
    return np.stack([map_coordinates(one, [row, column], order=1, mode="nearest") for one in channels], -1)
