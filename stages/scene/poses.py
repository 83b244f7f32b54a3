"""Poses, [R t] as 3×4 matrices: inverses, and the crossing between axes of cameras."""

from __future__ import annotations

import numpy as np

FLIP = np.diag([1.0, -1.0, -1.0])  # between (x right, y down, z forward) and (x right, y up, z backward)
UNROUND = 1e-3  # how far rotations, and quaternions from unit length, may be off: four digits are written so


def inverse(b_from_a: np.ndarray) -> np.ndarray:
    """Invert a rigid motion: [R t] becomes [Rᵀ −Rᵀt], shape (3, 4), float64."""
    rotation = b_from_a[:, :3].T
    return np.column_stack([rotation, -rotation @ b_from_a[:, 3]])


def with_flipped_camera_axes(cam_from_world: np.ndarray) -> np.ndarray:
    """Turn a camera's axes by 180° about x: COLMAP's to those of OpenGL, Blender and Bundler, or back.

    Parameters
    ----------
    cam_from_world : ndarray, shape (3, 4)
        In axes x right, y down, z forward; or x right, y up, z backward.

    Returns
    -------
    ndarray, shape (3, 4), float64
        The same pose in the other axes.
    """
    return FLIP @ cam_from_world


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """Find the rotation that a matrix is but for rounding and a positive scale, shape (3, 3), float64.

    Raises
    ------
    ValueError
        It is further from one than `UNROUND`: it is not finite, mirrors, shears, or is singular.
    """
    if not np.isfinite(matrix).all() or np.abs(matrix).max() == 0:
        raise ValueError("it is not finite or zero")
    left, scales, right = np.linalg.svd(matrix / np.abs(matrix).max())
    if scales[0] - scales[2] > UNROUND * scales[0]:
        raise ValueError("it stretches space")
    if np.linalg.det(left @ right) < 0:
        raise ValueError("it mirrors space")
    return left @ right
