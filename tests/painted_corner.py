"""Photos of a painted corner of a room, three planes that meet: enough for SIFT, and every pixel is known."""

from __future__ import annotations

import cv2
import numpy as np

from stages.scene.cameras import Camera, pixel_centres

TEXTURE_PX = 1024
ROOM = 4.0  # side of the walls, model units


def paint(seed: int) -> np.ndarray:
    """Three sheets of blotches at several scales, shape (3, n, n, 3), float32, linear in (0, 1)."""
    rng = np.random.default_rng(seed)
    sheets = np.zeros((3, TEXTURE_PX, TEXTURE_PX, 3), np.float32)
    for sheet in sheets:
        for cells in (16, 64, 256):
            blotches = rng.random((cells, cells, 3), np.float32)
            sheet += cv2.resize(blotches, (TEXTURE_PX, TEXTURE_PX), interpolation=cv2.INTER_CUBIC) / 3
    return np.clip(sheets, 0.02, 0.98)


def cameras(count: int, width: int = 320, height: int = 240, focal_px: float = 300.0) -> list[Camera]:
    """Cameras on an arc that look into the corner at the origin, from x, y, z > 0."""
    K = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1]])
    views = []
    for index, angle in enumerate(np.radians(np.linspace(25, 65, count))):
        centre = 3.4 * np.array([np.cos(angle), np.sin(angle), 0.55 + 0.1 * (index % 2)])
        forward = np.array([0.55, 0.55, 0.5]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(forward, right), forward])
        pose = np.column_stack([R, -R @ centre])
        views.append(Camera(f"view_{index:02d}", width, height, K, pose))
    return views


def render(
    camera: Camera, sheets: np.ndarray, radial: float = 0.0, centre_offset_px: float = 0.0
) -> np.ndarray:
    """Linear photo, shape (h, w, 3), through a SIMPLE_RADIAL lens with coefficient `radial`.

    Supersampled 2 × 2; the principal point lies `centre_offset_px` right of the intrinsics'.
    """
    xy = pixel_centres(2 * camera.width, 2 * camera.height).reshape(-1, 2) / 2
    xy = (xy - camera.intrinsics[:2, 2] - [centre_offset_px, 0]) / camera.focal_px
    undistorted = xy.copy()
    for _ in range(20):  # x_d = x_u (1 + k r_u²), solved by iteration
        undistorted = xy / (1 + radial * (undistorted**2).sum(axis=1, keepdims=True))
    rays = np.column_stack([undistorted, np.ones(len(xy))]) @ camera.rotation
    centre = camera.centre_in_world
    with np.errstate(divide="ignore"):
        distances = np.where(rays < 0, -centre / rays, np.inf)
    wall = distances.argmin(axis=1)
    hit = centre + distances.min(axis=1)[:, None] * rays
    seen = np.full((len(rays), 3), 0.02, np.float32)
    for axis in range(3):
        here = wall == axis
        uv = np.delete(hit[here], axis, axis=1) / ROOM * TEXTURE_PX
        u, v = (part.astype(np.float32).reshape(1, -1) for part in uv.T)
        # remap's sides are bounded at 32767: one row at a time of bounded length.
        for start in range(0, u.shape[1], 30000):
            part = slice(start, start + 30000)
            found = cv2.remap(
                sheets[axis], u[:, part], v[:, part], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
            )
            seen[np.flatnonzero(here)[part]] = found[0]
    image = seen.reshape(2 * camera.height, 2 * camera.width, 3)
    return cv2.resize(image, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
