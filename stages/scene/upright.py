"""The upright frame of environment maps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stages.scene.cameras import Camera

ROLL_DEG = 3.0  # by which hand-held cameras are off the horizontal, RMS


def vertical_of(cameras: Sequence[Camera]) -> np.ndarray:
    """Estimate the direction upwards from cameras that are held level: unit, world axes, shape (3,).

    Notes
    -----
    Whoever tilts a camera up or down keeps its x axis horizontal: with x_i these axes and m the mean of the
    up (−y) axes, the least of mean (x_i·u)² + ε |u − m|² is u ∝ (mean x_i x_iᵀ + ε I)⁻¹ m. Where all
    cameras look the same way, x_i leave a plane undetermined, and u is m in it. ε: square of the roll's sine.
    """
    sideways = np.stack([camera.rotation[0] for camera in cameras])
    up = -np.mean([camera.rotation[1] for camera in cameras], axis=0)
    if np.linalg.norm(up) < 1e-6:
        up = -cameras[0].rotation[1]
    roll = np.sin(np.deg2rad(ROLL_DEG)) ** 2
    vertical = np.linalg.solve(sideways.T @ sideways / len(sideways) + roll * np.eye(3), up)
    return vertical / np.linalg.norm(vertical)


def upright_from_world(cameras: Sequence[Camera], within_deg: float) -> np.ndarray:
    """Compute the rotation from the world to a frame whose z is up, (3, 3).

    Up is the world's axis nearest to the cameras' vertical, if it is within `within_deg` of it: frames made
    by hand, and by most programs, have an axis upwards. Otherwise it is the cameras' vertical itself. The
    rotation is the smallest that maps up to z, so it is the identity where the world's z is up.
    """
    up = vertical_of(cameras)
    axis = np.zeros(3)
    axis[np.abs(up).argmax()] = np.sign(up[np.abs(up).argmax()])
    if up @ axis > np.cos(np.deg2rad(within_deg)):
        up = axis
    return _smallest_rotation(up, np.array([0.0, 0, 1]))


def gltf_from_world(cameras: Sequence[Camera], within_deg: float) -> np.ndarray:
    """Compute the rotation from the world to glTF's axes, y up, (3, 3): upright, then z to y and −y to z."""
    return np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]) @ upright_from_world(cameras, within_deg)


def _smallest_rotation(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Compute the rotation of a unit vector to another; 180° about x where they are opposed (Rodrigues)."""
    cosine = float(one @ other)
    if cosine < -1 + 1e-12:
        return np.diag([1.0, -1, -1])
    x, y, z = np.cross(one, other)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + cosine)
