"""Where the cameras stand: exact pinholes on arcs around the figure."""

from __future__ import annotations

import numpy as np

from stages.scene.cameras import Camera


def arc_of_views(
    azimuths_deg: list[float],
    elevations_deg: list[float],
    distance: float,
    target: np.ndarray,
    size: tuple[int, int],
    focal_px: float,
) -> list[Camera]:
    """Cameras around `target`, all looking at it, z of the world up in the picture.

    Parameters
    ----------
    azimuths_deg, elevations_deg : list of float
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


def look_at(centre: np.ndarray, target: np.ndarray) -> np.ndarray:
    """cam_from_world of a camera at `centre` that looks at `target` with the world's z up, shape (3, 4)."""
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return np.concatenate([rotation, -rotation @ centre[:, None]], axis=1)
