"""Textured surface as a camera sees it."""

from __future__ import annotations

from collections.abc import Sequence
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
    """A mesh with textures, made ready for rays.

    Parameters
    ----------
    surface : Surface
        F faces.
    uv : ndarray, shape (F, 3, 2)
        Of the faces' corners; v downwards, as rows of a texture. Beyond [0, 1] textures are repeated.
    textures : sequence of ndarray, shape (s, s, c), float32
    texture_of : ndarray, shape (F,), int
        Which of them each face has.
    """

    def __init__(
        self, surface: Surface, uv: np.ndarray, textures: Sequence[np.ndarray], texture_of: np.ndarray
    ) -> None:
        self._caster, self._uv, self._textures, self._texture_of = (
            RayCaster(surface),
            uv,
            textures,
            texture_of,
        )

    @classmethod
    def of_atlas(cls, surface: Surface, uv: np.ndarray, atlas: np.ndarray) -> TexturedSurface:
        """Make one of a single texture whose coordinates, (V, 2), are those of vertices."""
        return cls(surface, uv[surface.faces], [atlas], np.zeros(len(surface.faces), np.int64))

    def seen_by(self, camera: Camera, threads: int = 0) -> TexturedView:
        """Look up the textures at the centres of a camera's pixels, bilinearly between texels."""
        seen = self._caster.see(camera, threads)
        mask = seen.mask
        faces = seen.triangles[mask]
        corners = self._uv[faces]
        u, v = seen.barycentric[mask, :1], seen.barycentric[mask, 1:]
        uv = (1 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2]
        values = np.zeros((len(uv), self._textures[0].shape[2]), np.float32)
        for number, texture in enumerate(self._textures):
            own = self._texture_of[faces] == number
            values[own] = texture_at(texture, uv[own] - np.floor(uv[own]))
        points = back_project(camera, seen.depth)[mask]
        return TexturedView(mask, seen.depth, values, points, seen.normals[mask])


def texture_at(atlas: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Look up an atlas, (s, s, c), bilinearly at coordinates (..., 2) in [0, 1], v downwards: (..., c)."""
    column, row = np.moveaxis(xy_for_integer_centres(uv * len(atlas)), -1, 0)
    channels = np.moveaxis(atlas, -1, 0)
    return np.stack([map_coordinates(one, [row, column], order=1, mode="nearest") for one in channels], -1)
