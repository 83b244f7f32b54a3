"""Sets of photos as people take them: of a painted corner, from known places, with what goes wrong."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from benchmarks.fountain_poses import Poses
from stages.formats.images.photos import write_png_srgb8
from stages.scene.cameras import Camera, rays_in_world
from tests import painted_corner

SIZE = 320, 240
FOCAL_PX = 300.0
ASIDE = 24.0  # degrees off the diagonal to either side, of the arc of cameras
TARGET = np.array([0.55, 0.55, 0.5])


def looking(
    name: str,
    centre: Sequence[float],
    target: Sequence[float] = TARGET,
    size: tuple[int, int] = SIZE,
    focal_px: float = FOCAL_PX,
) -> Camera:
    """A camera at `centre` that looks at `target`, z of the world up."""
    centre = np.asarray(centre, float)
    forward = np.asarray(target, float) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[focal_px, 0, size[0] / 2], [0, focal_px, size[1] / 2], [0, 0, 1]])
    return Camera(name, *size, K, np.column_stack([R, -R @ centre]))


def around(
    count: int, size: tuple[int, int] = SIZE, focal_px: float = FOCAL_PX, apart_deg: float | None = None
) -> list[Camera]:
    """Cameras on an arc around the corner, at a distance at which the focal length shows the same of it."""
    angles = np.radians(45 + np.linspace(-1, 1, count) * (ASIDE if apart_deg is None else apart_deg / 2))
    away = 3.4 * focal_px / FOCAL_PX * SIZE[0] / max(size)
    places = [away * np.array([np.cos(a), np.sin(a), 0.55 + 0.1 * (i % 2)]) for i, a in enumerate(angles)]
    return [looking(f"view_{i:02d}", place, TARGET, size, focal_px) for i, place in enumerate(places)]


def before_a_wall(count: int, focal_px: float = FOCAL_PX) -> list[Camera]:
    """Cameras before the wall x = 0, which is all that they see."""
    steps = np.linspace(-0.7, 0.7, count)
    places = [(1.6, 2 + step, 2 + 0.2 * (i % 2)) for i, step in enumerate(steps)]
    return [looking(f"wall_{i:02d}", place, (0, 2, 2), focal_px=focal_px) for i, place in enumerate(places)]


def photos(cameras: Sequence[Camera], seed: int = 0, radial: float = 0.0) -> list[np.ndarray]:
    """Linear photos (h, w, 3) of the corner that is painted by `seed`."""
    sheets = painted_corner.paint(seed)
    return [painted_corner.render(camera, sheets, radial) for camera in cameras]


def turntable(count: int, background: float, seed: int = 0) -> list[np.ndarray]:
    """Photos by one unmoving camera: a painted box turns, 12° from photo to photo, before a still corner.

    `background` scales the corner's paint: at 0 there is nothing behind the box but black.
    """
    (camera,) = around(1)
    behind = photos([camera], seed)[0] * np.float32(background)
    sheets = painted_corner.paint(seed + 50)
    rays = rays_in_world(camera).reshape(-1, 3)
    origin = camera.centre_in_world
    return [_box_before(behind, origin, rays, sheets, np.radians(12 * i)) for i in range(count)]


def _box_before(
    behind: np.ndarray, origin: np.ndarray, rays: np.ndarray, sheets: np.ndarray, turn: float
) -> np.ndarray:
    """The photo with a box of side 1.4, turned by `turn` around the vertical through the target."""
    back = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    a, d, half = back @ (origin - TARGET), rays @ back.T, 0.7
    with np.errstate(divide="ignore"):
        enter = np.minimum((-half - a) / d, (half - a) / d)
        leave = np.maximum((-half - a) / d, (half - a) / d)
    near, axis = enter.max(axis=1), enter.argmax(axis=1)
    hit = near < leave.min(axis=1)
    image = behind.reshape(-1, 3).copy()
    for face in range(3):
        here = np.flatnonzero(hit & (axis == face))
        if not len(here):
            continue
        x = a + near[here, None] * d[here]
        uv = (np.delete(x, face, axis=1) / (2 * half) + 0.5) * 500 + np.where(x[:, face] > 0, 0, 510)[:, None]
        u, v = (part.astype(np.float32)[:, None] for part in uv.T)
        image[here] = cv2.remap(sheets[face], u, v, cv2.INTER_LINEAR)[:, 0]
    return image.reshape(behind.shape)


def blurred(linear: np.ndarray, length_px: int) -> np.ndarray:
    """A photo of a camera that moved along the rows while its shutter was open."""
    return cv2.blur(linear, (length_px, 1))


def write(folder: Path, cameras: Sequence[Camera], linear: Sequence[np.ndarray]) -> Path:
    """Write photos as PNG under their cameras' names."""
    for camera, photo in zip(cameras, linear, strict=True):
        write_png_srgb8(folder / f"{camera.name}.png", photo)
    return folder


def reencode(photo: Path, copy: Path, quality: int = 85) -> None:
    """Write a photo again as JPEG."""
    Image.open(photo).save(copy, quality=quality)


def true_poses(cameras: Sequence[Camera], extension: str = ".png") -> Poses:
    """The cameras' poses under the names of their photos."""
    return Poses(
        [camera.name + extension for camera in cameras],
        np.array([camera.centre_in_world for camera in cameras]),
        np.array([camera.rotation for camera in cameras]),
    )


def blur_file(photo: Path, length_px: int) -> None:
    """Blur a JPEG as a camera would that moved along the rows."""
    cv2.imwrite(str(photo), cv2.blur(cv2.imread(str(photo)), (length_px, 1)))


def as_if_around(camera: Camera, count: int) -> list[Camera]:
    """Where an unmoving camera was, as seen by the box that turned in `turntable`."""
    moved = []
    for index in range(count):
        turn = np.radians(12 * index)
        back = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
        centre = back @ (camera.centre_in_world - TARGET)
        moved.append(looking(f"turn_{index}", centre, (0, 0, 0)))
    return moved
