"""Signed distances of a few solids, and the smooth ways to join them: the clay that `bust` is made of.

Every function takes points of shape (n, 3) or distances of shape (n,), and returns distances, shape (n,),
negative inside. Lengths are in model units. Ellipsoids are first-order approximations: exact in sign, right
to a few per cent near the surface, which is all that an isosurface needs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def sphere(x: np.ndarray, centre: ArrayLike, radius: float) -> np.ndarray:
    """Distance to a sphere."""
    return np.linalg.norm(x - np.array(centre, x.dtype), axis=-1) - x.dtype.type(radius)


def ellipsoid(x: np.ndarray, centre: ArrayLike, radii: ArrayLike) -> np.ndarray:
    """Distance to an axis-aligned ellipsoid, to first order: k₀ (k₀ − 1) / k₁, kₙ = |(x − c) / rⁿ⁺¹|."""
    offset, radii = x - np.array(centre, x.dtype), np.array(radii, x.dtype)
    k0 = np.linalg.norm(offset / radii, axis=-1)
    k1 = np.linalg.norm(offset / (radii * radii), axis=-1)
    return k0 * (k0 - 1) / np.maximum(k1, x.dtype.type(1e-9))


def capsule(
    x: np.ndarray, start: ArrayLike, end: ArrayLike, radius_start: float, radius_end: float
) -> np.ndarray:
    """Distance to a segment swept by a sphere whose radius goes from `radius_start` to `radius_end`."""
    start, end = np.array(start, x.dtype), np.array(end, x.dtype)
    axis = end - start
    along = np.clip((x - start) @ axis / (axis @ axis), 0, 1)
    radius = radius_start + (radius_end - radius_start) * along
    return np.linalg.norm(x - start - along[:, None] * axis, axis=-1) - radius.astype(x.dtype)


def torus(x: np.ndarray, centre: ArrayLike, normal: ArrayLike, ring: float, tube: float) -> np.ndarray:
    """Distance to a torus: a circle of radius `ring` around the axis `normal`, thickened by `tube`."""
    normal = np.array(normal, x.dtype) / x.dtype.type(np.linalg.norm(normal))
    offset = x - np.array(centre, x.dtype)
    height = offset @ normal
    radial = np.linalg.norm(offset - height[:, None] * normal, axis=-1)
    return np.hypot(radial - x.dtype.type(ring), height) - x.dtype.type(tube)


def upright_cylinder(x: np.ndarray, bottom: float, top: float, radius: float, rounding: float) -> np.ndarray:
    """Distance to a cylinder around the z axis whose edges are rounded by `rounding`."""
    radial = np.hypot(x[:, 0], x[:, 1]) - x.dtype.type(radius - rounding)
    height = np.abs(x[:, 2] - x.dtype.type((bottom + top) / 2)) - x.dtype.type((top - bottom) / 2 - rounding)
    outside = np.hypot(np.maximum(radial, 0), np.maximum(height, 0))
    return outside + np.minimum(np.maximum(radial, height), 0) - x.dtype.type(rounding)


def smooth_union(a: np.ndarray, b: np.ndarray, blend: float) -> np.ndarray:
    """Union whose crease is filleted over the length `blend` (quadratic polynomial minimum)."""
    overlap = np.maximum(blend - np.abs(a - b), 0) / a.dtype.type(blend)
    return np.minimum(a, b) - overlap * overlap * a.dtype.type(blend / 4)


def smooth_subtraction(solid: np.ndarray, hole: np.ndarray, blend: float) -> np.ndarray:
    """`solid` without `hole`, the rim rounded over the length `blend`."""
    return -smooth_union(-solid, hole, blend)


def box(x: np.ndarray, low: ArrayLike, high: ArrayLike, rounding: float = 0.0) -> np.ndarray:
    """Distance to an axis-aligned box whose edges are rounded by `rounding`."""
    low, high = np.array(low, x.dtype), np.array(high, x.dtype)
    beyond = np.abs(x - (low + high) / 2) - ((high - low) / 2 - x.dtype.type(rounding))
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=-1)
    return outside + np.minimum(beyond.max(axis=-1), 0) - x.dtype.type(rounding)


def arch_outline(across: np.ndarray, up: np.ndarray, half_width: float, springing: float) -> np.ndarray:
    """Distance in a plane to an arch: a strip from below up to `springing`, closed by a half circle."""
    above = np.maximum(up - up.dtype.type(springing), 0)
    return np.hypot(across, above) - across.dtype.type(half_width)


def extruded(outline: np.ndarray, along: np.ndarray, start: float, end: float) -> np.ndarray:
    """Distance to a plane outline drawn out from `start` to `end` along its normal."""
    middle, half = along.dtype.type((start + end) / 2), along.dtype.type((end - start) / 2)
    beyond = np.abs(along - middle) - half
    outside = np.hypot(np.maximum(outline, 0), np.maximum(beyond, 0))
    return outside + np.minimum(np.maximum(outline, beyond), 0)
