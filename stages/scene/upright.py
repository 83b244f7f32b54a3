"""The upright frame of environment maps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stages.scene.cameras import Camera


def mean_camera_up(cameras: Sequence[Camera]) -> np.ndarray:
    """Average the cameras' up (−y) axes: unit, world axes, shape (3,)."""
    up = -np.mean([camera.rotation[1] for camera in cameras], axis=0)
    length = float(np.linalg.norm(up))
    return up / length if length > 1e-6 else -cameras[0].rotation[1]


def upright_from_world(cameras: Sequence[Camera], within_deg: float) -> np.ndarray:
    """Compute the rotation from the world to a frame whose z is up, (3, 3).

    Up is the world's axis nearest to the cameras' mean up (−y), if it is within `within_deg` of it: frames
    made by hand, and by most programs, have an axis upwards. Otherwise it is the cameras' mean up itself. The
    rotation is the smallest that maps up to z, so it is the identity where the world's z is up.
    """
    up = mean_camera_up(cameras)
    axis = np.zeros(3)
    axis[np.abs(up).argmax()] = np.sign(up[np.abs(up).argmax()])
    if up @ axis > np.cos(np.deg2rad(within_deg)):
        up = axis
    return _smallest_rotation(up, np.array([0.0, 0, 1]))


def _smallest_rotation(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Compute the rotation of a unit vector to another; 180° about x where they are opposed (Rodrigues)."""
    cosine = float(one @ other)
    if cosine < -1 + 1e-12:
        return np.diag([1.0, -1, -1])
    x, y, z = np.cross(one, other)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + cosine)
