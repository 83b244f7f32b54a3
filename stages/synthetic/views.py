"""Where the cameras stand: exact pinholes on arcs around the figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stages.scene.cameras import Camera


def arc_of_views(
    azimuths_deg: Sequence[float],
    elevations_deg: Sequence[float],
    distance: float,
    target: np.ndarray,
    size: tuple[int, int],
    focal_px: float,
) -> list[Camera]:
    """Cameras around `target`, all looking at it, z of the world up in the picture.

    Parameters
    ----------
    azimuths_deg, elevations_deg : sequence of float
        One per view. Azimuth 0 faces the figure (from −y), positive towards its left (+x).
    distance : float
        From `target` to the camera centres, model units.
    target : ndarray, shape (3,)
    size : tuple of int
        Width and height, pixels.
    focal_px : float

    Returns
    -------
    list of Camera
        Named 000, 001, …; principal point at the image's centre.
    """
    width, height = size
    intrinsics = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1.0]])
    cameras = []
    for index, (azimuth, elevation) in enumerate(zip(azimuths_deg, elevations_deg, strict=True)):
        a, e = np.deg2rad([azimuth, elevation])
        backward = np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
        pose = look_at(target + distance * backward, target)
        cameras.append(Camera(f"{index:03d}", width, height, intrinsics, pose))
    return cameras


def framed(cameras: list[Camera], points: np.ndarray, margin: float = 0.04) -> list[Camera]:
    """The cameras with the longest common focal length at which all points, (n, 3), are in every picture.

    A `margin`, as a share of the picture's width and height, stays free on all sides. Principal points must
    lie in the middle.
    """
    focal_px = np.inf
    for camera in cameras:
        x, y, z = camera.rotation @ points.T + camera.cam_from_world[:, 3:]
        for along, side in ((x, camera.width), (y, camera.height)):
            focal_px = min(focal_px, side * (0.5 - margin) / float(np.max(np.abs(along) / z)))
    return [replace(camera, intrinsics=_with_focal(camera.intrinsics, focal_px)) for camera in cameras]


def _with_focal(intrinsics: np.ndarray, focal_px: float) -> np.ndarray:
    changed = intrinsics.copy()
    changed[0, 0] = changed[1, 1] = focal_px
    return changed


def look_at(centre: np.ndarray, target: np.ndarray) -> np.ndarray:
    """cam_from_world of a camera at `centre` that looks at `target` with the world's z up, shape (3, 4)."""
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return np.concatenate([rotation, -rotation @ centre[:, None]], axis=1)
