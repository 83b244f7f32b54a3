"""Planes written as inverse depth: the one parametrisation that sweep, refinement and consistency share.

On a plane, 1/z is *linear* in image coordinates. So a surface element behind pixel p is three numbers, its
inverse depth w at p and the two slopes of w along x and y, and extending it to a neighbour is w + sx·Δx +
sy·Δy. Everything here counts pixels by array index (centre of the first pixel at (0, 0)); `j_from_i` holds
that half-pixel.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from stages.scene.cameras import (
    Camera,
    centres_along,
    intrinsics_for_integer_centres,
    xy_for_integer_centres,
)

F = np.float32


def j_from_i(camera_i: Camera, camera_j: Camera) -> np.ndarray:
    """Build the projection of i's pixels with inverse depth into j, shape (3, 4), float64 (Eq. 7 twice).

    ``q = P @ [x, y, 1, 1/z]`` with (x, y) an array index of view i; ``q[:2] / q[2]`` is the array index in
    j, and q[2] is z_j / z_i. P = [K_j R_ji K_i⁻¹ | K_j t_ji].
    """
    rotation = camera_j.rotation @ camera_i.rotation.T
    translation = camera_j.cam_from_world[:, 3] - rotation @ camera_i.cam_from_world[:, 3]
    k_i = intrinsics_for_integer_centres(camera_i.intrinsics)
    k_j = intrinsics_for_integer_centres(camera_j.intrinsics)
    return np.column_stack([k_j @ rotation @ np.linalg.inv(k_i), k_j @ translation])


def normals_from_planes(planes: np.ndarray, camera: Camera) -> np.ndarray:
    """Compute unit normals, camera axes, towards the camera, (h, w, 3), float32; zero unless w is positive.

    With 1/z = a·(x, y, 1) the plane is (Kᵀa)·X = 1, so the normal is −Kᵀa, normalised.

    Parameters
    ----------
    planes : ndarray, shape (h, w, 3), float32
        Inverse depth and its two slopes per pixel.
    camera : Camera
    """
    return _normals(np.ascontiguousarray(planes), intrinsics_for_integer_centres(camera.intrinsics))


@njit(cache=True, nogil=True)
def _normals(planes, k):
    height, width, _ = planes.shape
    normals = np.zeros((height, width, 3), np.float32)
    for y in range(height):
        for x in range(width):
            w, slope_x, slope_y = planes[y, x, 0], planes[y, x, 1], planes[y, x, 2]
            if w <= 0:
                continue
            constant = w - slope_x * x - slope_y * y
            n0 = k[0, 0] * slope_x
            n1 = k[0, 1] * slope_x + k[1, 1] * slope_y
            n2 = k[0, 2] * slope_x + k[1, 2] * slope_y + constant
            length = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
            if length > 0:
                normals[y, x, 0] = -n0 / length
                normals[y, x, 1] = -n1 / length
                normals[y, x, 2] = -n2 / length
    return normals


def depth_from_planes(planes: np.ndarray) -> np.ndarray:
    """Compute z-depth, shape (h, w), float32; 0 where the inverse depth is not positive."""
    inverse = planes[..., 0]
    return np.where(inverse > 0, F(1) / np.where(inverse > 0, inverse, F(1)), F(0)).astype(np.float32)


@njit(cache=True, nogil=True)
def fit_planes(inverse: np.ndarray, step: float, radius: int, tolerance: float) -> np.ndarray:
    """Fit slopes to an inverse-depth map by local least squares over neighbours on the same surface.

    Parameters
    ----------
    inverse : ndarray, shape (h, w), float32
    step : float
        Inverse depth per pixel of disparity; a neighbour at distance r counts while it differs by less than
        (`tolerance` + r) steps, which keeps the other side of a depth edge out.
    radius : int
        Half size of the window, pixels.
    tolerance : float

    Returns
    -------
    ndarray, shape (h, w, 3), float32
        Planes: the input and its slopes.
    """
    height, width = inverse.shape
    planes = np.zeros((height, width, 3), np.float32)
    for y in range(height):
        for x in range(width):
            sxx = sxy = syy = sxw = syw = 0.0
            for dy in range(-min(radius, y), min(radius, height - 1 - y) + 1):
                for dx in range(-min(radius, x), min(radius, width - 1 - x) + 1):
                    dw = inverse[y + dy, x + dx] - inverse[y, x]
                    if abs(dw) < (tolerance + max(abs(dx), abs(dy))) * step:
                        sxx += dx * dx
                        sxy += dx * dy
                        syy += dy * dy
                        sxw += dx * dw
                        syw += dy * dw
            planes[y, x, 0] = inverse[y, x]
            determinant = sxx * syy - sxy * sxy
            if determinant > 1e-6:
                planes[y, x, 1] = (syy * sxw - sxy * syw) / determinant
                planes[y, x, 2] = (sxx * syw - sxy * sxw) / determinant
    return planes


def resample_planes(planes: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Resample planes to another image size: each pixel extends the nearest's plane, (*shape, 3), float32."""
    height, width = planes.shape[:2]
    scale_x, scale_y = width / shape[1], height / shape[0]
    x = xy_for_integer_centres(centres_along(shape[1]) * scale_x)
    y = xy_for_integer_centres(centres_along(shape[0]) * scale_y)
    column = np.clip(np.rint(x), 0, width - 1).astype(int)
    row = np.clip(np.rint(y), 0, height - 1).astype(int)
    found = planes[row[:, None], column[None, :]]
    shift = found[..., 1] * (x - column)[None, :] + found[..., 2] * (y - row)[:, None]
    inverse = np.maximum(found[..., 0] + shift, 0.0)
    return np.stack([inverse, found[..., 1] * scale_x, found[..., 2] * scale_y], axis=-1).astype(np.float32)
