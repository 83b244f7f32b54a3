"""A street front of any length: bays of one relief, each in a paint of its own, and cameras that pass it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.surface import with_faces
from stages.scene.cameras import Camera
from stages.synthetic.paints.natural_paint import natural_paint
from stages.synthetic.paints.textures.pattern import Scale
from stages.synthetic.subjects.architecture import relief_distances
from stages.synthetic.subjects.isosurface import closed_surface
from stages.synthetic.views import look_at

BAY = 0.98  # length of a bay, model units: its neighbours overlap by a little, so that the wall has no joint
SPACING = 0.008  # of the mesh's grid, model units: five pixels
BACK = 0.12  # faces that lie farther back are left out: nobody sees them
BELOW, ABOVE = 0.0, 0.72  # what the views show of the wall
DISTANCE = 1.15  # of the cameras
STEP = 0.12  # from one camera to the next: a point is seen by about ten
HEIGHTS = (0.22, 0.50)  # of the cameras, in turn
SIDEWAYS = (-0.25, 0.0, 0.25)  # where they look, in turn
TEXTURES = ("masonry", "stains", "rubble", "fractal", "rust_and_moss", "print")
CONTRASTS = (0.25, 0.15, 0.35, 0.10, 0.40, 0.12)
SLANT = 0.6  # paint is looked up at (x + 0.6 y, z + 0.6 y), so that it is no streak on the sides of a niche


@dataclass(frozen=True, eq=False)
class Street:
    """A street front.

    Attributes
    ----------
    surface : Surface
        Front of the wall, facing −y; z is up, x along the street.
    paint : ndarray, shape (h, w, 3), float32
        Albedo on a grid of x (columns) and z (rows).
    begin : float
        x of the first column.
    texel : float
        Side of a cell of that grid, model units.
    cameras : list of Camera
    """

    surface: Surface
    paint: np.ndarray
    begin: float
    texel: float
    cameras: list[Camera]

    def albedo(self, points: np.ndarray) -> np.ndarray:
        """Look up the albedo at surface points, (n, 3); (n, 3), float32."""
        along, up = points[:, 0] + SLANT * points[:, 1] - self.begin, points[:, 2] + SLANT * points[:, 1]
        column, row = (along / self.texel).astype(np.float32), ((up - BELOW) / self.texel).astype(np.float32)
        return np.concatenate(  # OpenCV's maps are of limited size
            [
                cv2.remap(self.paint, x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)[0]
                for x, y in zip(_pieces(column), _pieces(row), strict=True)
            ]
        )


def build_street(views: int, width_px: int, height_px: int) -> Street:
    """Build the front that so many views of this size pass by."""
    cameras = _cameras(views, width_px, height_px)
    half = views * STEP / 2 + DISTANCE
    texel = DISTANCE / cameras[0].focal_px / 1.5
    return Street(_front(half), _paint(half, texel), -half, texel, cameras)


def _cameras(views: int, width_px: int, height_px: int) -> list[Camera]:
    """Stand cameras along the street, from its begin to its end."""
    focal_px = height_px * DISTANCE / (ABOVE - BELOW)
    intrinsics = np.array([[focal_px, 0, width_px / 2], [0, focal_px, height_px / 2], [0, 0, 1.0]])
    cameras = []
    for number in range(views):
        along = (number - (views - 1) / 2) * STEP
        centre = np.array([along, -DISTANCE, HEIGHTS[number % len(HEIGHTS)]])
        target = np.array([along + SIDEWAYS[number % len(SIDEWAYS)], 0.0, (BELOW + ABOVE) / 2])
        cameras.append(Camera(f"{number:04d}", width_px, height_px, intrinsics, look_at(centre, target)))
    return cameras


def _front(half: float) -> Surface:
    """Mesh the front between −half and half, without its back."""
    low, high = np.array([-half - 0.0717, -0.3123, -0.0431]), np.array([half + 0.07, 0.27, 0.79])
    surface = closed_surface(partial(_distance, half=half), low, high, SPACING)
    shown = (surface.vertices[surface.faces, 1] < BACK).any(axis=1)
    return with_faces(surface, shown)


def _distance(x: np.ndarray, half: float) -> np.ndarray:
    """Evaluate the signed distance of the relief, repeated from the begin of the street, as its paint is."""
    folded = x.copy()
    along = x[:, 0] + np.float32(half)
    folded[:, 0] = along - np.float32(BAY) * np.round(along / np.float32(BAY))
    return np.maximum(relief_distances(folded).min(axis=0), np.abs(x[:, 0]) - np.float32(half))


def _paint(half: float, texel: float) -> np.ndarray:
    """Paint every bay, in turn by the textures, each by a seed of its own."""
    bays = int(np.ceil(2 * half / BAY))
    columns, rows = int(np.ceil(BAY / texel)), int(np.ceil((ABOVE - BELOW + 0.1) / texel))
    along, up = np.meshgrid(np.arange(columns) * texel, np.arange(rows) * texel)
    places = np.stack([along.ravel(), np.zeros(along.size), up.ravel()], axis=1)
    scale = Scale(3 * texel, BAY / 2)
    painted = [
        natural_paint(TEXTURES[bay % len(TEXTURES)], places, scale, CONTRASTS[bay % len(TEXTURES)], seed=bay)
        for bay in range(bays)
    ]
    return np.concatenate([one.reshape(rows, columns, 3) for one in painted], axis=1)


def _pieces(values: np.ndarray, length: int = 30_000) -> list[np.ndarray]:
    return [values[begin : begin + length] for begin in range(0, len(values), length)]
