"""Texels of an atlas on the surface: which face each lies in, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.occluders import first_faces, scene_of
from stages.geometry.rays import NO_TRIANGLE, face_normals
from stages.scene.cameras import Camera, smallest_footprints
from stages.texturing.settings import ChartSettings
from stages.texturing.unwrapping import ChartedMesh

ROWS_AT_ONCE = 256  # of an atlas: bounds the memory of rays


@dataclass(frozen=True, eq=False)
class Texels:
    """Texels whose centres lie in a chart.

    Attributes
    ----------
    side : int
        Of the atlas.
    place : ndarray, shape (T,), int64
        row · side + column.
    face : ndarray, shape (T,), int32
    corners : ndarray, shape (T, 2), float32
        Barycentric coordinates of the face's second and third corner.
    """

    side: int
    place: np.ndarray
    face: np.ndarray
    corners: np.ndarray

    def __len__(self) -> int:
        return len(self.place)

    def weights(self) -> np.ndarray:
        """Compute barycentric coordinates of all three corners, (T, 3), float32."""
        return np.concatenate([1 - self.corners.sum(axis=1, keepdims=True), self.corners], axis=1)

    def interpolated(self, mesh: ChartedMesh, of_vertices: np.ndarray) -> np.ndarray:
        """Interpolate values of vertices, (V, c), to the texels, (T, c), float32."""
        weights, corners = self.weights(), mesh.faces[self.face]
        values = of_vertices.astype(np.float32)
        return sum(weights[:, k, None] * values[corners[:, k]] for k in range(3))

    def image(self, values: np.ndarray, background: float = 0) -> np.ndarray:
        """Arrange values of texels, (T, …), as an image (side, side, …)."""
        filled = np.full((self.side**2, *values.shape[1:]), background, values.dtype)
        filled[self.place] = values
        return filled.reshape(self.side, self.side, *values.shape[1:])


def side_of_atlas(surface: Surface, cameras: list[Camera], how: ChartSettings) -> int:
    """Choose the side of the atlas: a power of two with texels as small as the nearest view's pixels.

    Parameters
    ----------
    surface : Surface
    cameras : list of Camera
        At the size of the maps that the texture is made from.
    how : ChartSettings
    """
    middles = surface.vertices[surface.faces].mean(axis=1)
    areas = np.linalg.norm(face_normals(surface.vertices, surface.faces), axis=1) / 2
    smallest = smallest_footprints(middles, cameras) / how.texels_per_pixel
    seen = np.isfinite(smallest)
    texels = float((areas[seen] / smallest[seen] ** 2).sum()) / how.expected_use
    side = 2 ** int(np.ceil(np.log2(max(np.sqrt(texels), 1))))
    return int(np.clip(side, how.least_px, how.most_px))


def texels_of(mesh: ChartedMesh, side: int, threads: int) -> Texels:
    """Find the face under the centre of every texel, by rays on to the charts laid flat."""
    flat = np.concatenate([mesh.uv * side, np.zeros((len(mesh.uv), 1))], axis=1)
    scene, origin = scene_of(Surface(flat, mesh.faces), threads)
    places, faces, corners = [], [], []
    columns = np.arange(side) + 0.5
    for first in range(0, side, ROWS_AT_ONCE):
        rows = np.arange(first, min(first + ROWS_AT_ONCE, side)) + 0.5
        x, y = np.meshgrid(columns, rows)
        rays = np.zeros((*x.shape, 6), np.float32)
        rays[..., 0], rays[..., 1], rays[..., 2], rays[..., 5] = x - origin[0], y - origin[1], 1, -1
        found, within = first_faces(scene, rays, threads)
        hit = found != NO_TRIANGLE
        places.append(np.flatnonzero(hit) + first * side)
        faces.append(found[hit].astype(np.int32))
        corners.append(within[hit])
    return Texels(side, np.concatenate(places), np.concatenate(faces), np.concatenate(corners))
