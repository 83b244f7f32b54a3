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


def ring_of_views(
    count: int,
    first_from: np.ndarray,
    elevation_deg: float,
    distance: float,
    points: np.ndarray,
    size: tuple[int, int],
    upright_from_world: np.ndarray,
) -> list[Camera]:
    """Cameras evenly around points, counter-clockwise seen from above, all points in every picture.

    Parameters
    ----------
    count : int
    first_from : ndarray, shape (3,)
        A place, world axes, on whose side of the vertical axis the first camera is.
    elevation_deg : float
        Of the cameras above the horizon.
    distance : float
        From the middle of the points' upright box, in radii of the points about it.
    points : ndarray, shape (n, 3)
        World axes.
    size : tuple of int
        Width and height, pixels.
    upright_from_world : ndarray, shape (3, 3)
        Rotation to axes whose z is up.
    """
    upright = points @ upright_from_world.T
    middle = (upright.min(axis=0) + upright.max(axis=0)) / 2
    radius = float(np.linalg.norm(upright - middle, axis=1).max())
    x, y, _ = upright_from_world @ first_from - middle
    azimuths_deg = np.rad2deg(np.arctan2(x, -y)) + 360 * np.arange(count) / count
    around = arc_of_views(
        azimuths_deg.tolist(), [elevation_deg] * count, distance * radius, middle, size, focal_px=1.0
    )
    return [_turned(camera, upright_from_world) for camera in framed(around, upright)]


def elevations_of(
    cameras: Sequence[Camera], target: np.ndarray, upright_from_world: np.ndarray
) -> np.ndarray:
    """Compute the elevations, degrees, (n,), at which cameras stand as seen from a place, world axes."""
    away = np.stack([camera.centre_in_world - target for camera in cameras]) @ upright_from_world.T
    return np.rad2deg(np.arctan2(away[:, 2], np.linalg.norm(away[:, :2], axis=1)))


def _turned(camera: Camera, camera_axes_from_world: np.ndarray) -> Camera:
    """Express a camera's pose in world axes, from axes that are rotated against them."""
    rotation = camera.rotation @ camera_axes_from_world
    return replace(camera, cam_from_world=np.column_stack([rotation, camera.cam_from_world[:, 3]]))
