"""Fusion of depth maps into one cloud: each surface element once, averaged over the views that agree."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit

from stages.stereo.mvs_settings import MvsSettings

F = np.float32


@dataclass(frozen=True, eq=False)
class FusedPoints:
    """An oriented, coloured cloud.

    Attributes
    ----------
    x_in_world : ndarray, shape (n, 3), float64
    normals : ndarray, shape (n, 3), float32
        Unit, world axes.
    colours : ndarray, shape (n, 3), uint8
        As in the images, sRGB.
    pixel_sizes : ndarray, shape (n,), uint16
        Of the pixels that a point was found with, in pixels of the full size.
    """

    x_in_world: np.ndarray
    normals: np.ndarray
    colours: np.ndarray
    pixel_sizes: np.ndarray

    def chosen(self, keep: np.ndarray) -> FusedPoints:
        """Choose the points of a boolean mask or index array."""
        return FusedPoints(
            self.x_in_world[keep], self.normals[keep], self.colours[keep], self.pixel_sizes[keep]
        )

    @staticmethod
    def at_full_size(x_in_world: np.ndarray, normals: np.ndarray, colours: np.ndarray) -> FusedPoints:
        """Build a cloud of points that were all found with pixels of the full size."""
        return FusedPoints(x_in_world, normals, colours, np.ones(len(x_in_world), np.uint16))

    def at_scale(self, scale: float) -> FusedPoints:
        """Say that all points were found in images reduced by `scale`, 1 / a whole number."""
        return replace(self, pixel_sizes=np.full(len(self.x_in_world), round(1 / scale), np.uint16))

    @staticmethod
    def joined(parts: list[FusedPoints]) -> FusedPoints:
        """Concatenate clouds."""
        return FusedPoints(
            np.concatenate([part.x_in_world for part in parts]).reshape(-1, 3),
            np.concatenate([part.normals for part in parts]).reshape(-1, 3),
            np.concatenate([part.colours for part in parts]).reshape(-1, 3),
            np.concatenate([part.pixel_sizes for part in parts]),
        )


class DepthViews(NamedTuple):
    """The view to be fused (index 0) and its sources, padded to a common size.

    Attributes
    ----------
    sizes : ndarray, shape (S + 1, 2), int32
    inverse : ndarray, shape (S + 1, H, W), float32
        Inverse depth, 0 where unknown.
    normals : ndarray, shape (S + 1, H, W, 3), float32
        World axes.
    colours : ndarray, shape (S + 1, H, W, 3), uint8
    used : ndarray, shape (S + 1, H, W), bool
        Pixels that are part of the cloud already; **updated**.
    projections, back : ndarray, shape (S + 1, 3, 4), float64
        `j_from_i` and `i_from_j` between view 0 and each.
    rays : ndarray, shape (S + 1, 3, 3), float64
        Array index (x, y, 1) to the ray of z = 1 in world axes.
    centres : ndarray, shape (S + 1, 3), float64
    """

    sizes: np.ndarray
    inverse: np.ndarray
    normals: np.ndarray
    colours: np.ndarray
    used: np.ndarray
    projections: np.ndarray
    back: np.ndarray
    rays: np.ndarray
    centres: np.ndarray


@njit(cache=True, nogil=True)
def _counterpart(views, s, y, x, reprojection_px, depth_share, cosine):
    """Row and column of the pixel of source s that shows the same element, or (−1, −1)."""
    w = views.inverse[0, y, x]
    p = views.projections[s]
    q = p[:, 0] * x + p[:, 1] * y + p[:, 2] + p[:, 3] * w
    if q[2] <= 0:
        return -1, -1
    column, row = int(np.floor(q[0] / q[2] + 0.5)), int(np.floor(q[1] / q[2] + 0.5))
    if not (0 <= row < views.sizes[s, 0] and 0 <= column < views.sizes[s, 1]):
        return -1, -1
    other = views.inverse[s, row, column]
    if other <= 0 or abs(w / q[2] - other) > depth_share * other:
        return -1, -1
    b = views.back[s]
    r = b[:, 0] * column + b[:, 1] * row + b[:, 2] + b[:, 3] * other
    if r[2] <= 0 or np.hypot(r[0] / r[2] - x, r[1] / r[2] - y) > reprojection_px:
        return -1, -1
    alike = 0.0
    for axis in range(3):
        alike += views.normals[0, y, x, axis] * views.normals[s, row, column, axis]
    if alike < cosine:
        return -1, -1
    return row, column


@njit(cache=True, nogil=True)
def _add(views, s, y, x, sums):
    """Add an element to the sums of position (0–2), normal (3–5), colour (6–8) and of the weights (9)."""
    w = views.inverse[s, y, x]
    weight = w * w
    ray = views.rays[s]
    for axis in range(3):
        direction = ray[axis, 0] * x + ray[axis, 1] * y + ray[axis, 2]
        sums[axis] += weight * (views.centres[s, axis] + direction / w)
        sums[3 + axis] += weight * views.normals[s, y, x, axis]
        sums[6 + axis] += weight * views.colours[s, y, x, axis]
    sums[9] += weight


@njit(cache=True, nogil=True)
def _fuse(views, reprojection_px, depth_share, cosine, fewest):
    height, width = views.sizes[0]
    rows = np.empty((height * width, 9), np.float64)
    found = 0
    sums = np.empty(10, np.float64)
    members = np.empty((views.sizes.shape[0], 3), np.int64)
    for y in range(height):
        for x in range(width):
            if views.inverse[0, y, x] <= 0 or views.used[0, y, x]:
                continue
            count = 1
            sums[:] = 0
            _add(views, 0, y, x, sums)
            members[0, 0], members[0, 1], members[0, 2] = 0, y, x
            for s in range(1, views.sizes.shape[0]):
                row, column = _counterpart(views, s, y, x, reprojection_px, depth_share, cosine)
                if row >= 0:
                    if not views.used[s, row, column]:
                        _add(views, s, row, column, sums)
                    members[count, 0], members[count, 1], members[count, 2] = s, row, column
                    count += 1
            if count >= fewest:
                for k in range(count):
                    views.used[members[k, 0], members[k, 1], members[k, 2]] = True
                rows[found] = sums[:9] / sums[9]
                found += 1
    return rows[:found].copy()


def fuse_view(views: DepthViews, settings: MvsSettings, fewest_views: int) -> FusedPoints:
    """Fuse those pixels of a view that are not in the cloud yet and that enough views agree on.

    Positions, normals and colours are means over the agreeing pixels, weighted by 1/z². Pixels that have
    gone into a point are marked in ``views.used``, and are not averaged a second time.

    Parameters
    ----------
    views : DepthViews
    settings : MvsSettings
        When a pixel of another view is the same surface element: its point falls within `consistent_px` of
        the first pixel, its depth differs by at most `fusion_depth_share` and its normal by at most
        `fusion_normal_deg`.
    fewest_views : int
        Views that must agree, the first included.
    """
    cosine = float(np.cos(np.deg2rad(settings.fusion_normal_deg)))
    rows = _fuse(views, settings.consistent_px, settings.fusion_depth_share, cosine, fewest_views)
    normals = rows[:, 3:6] / np.maximum(np.linalg.norm(rows[:, 3:6], axis=1, keepdims=True), 1e-12)
    colours = np.clip(np.rint(rows[:, 6:]), 0, 255).astype(np.uint8)
    return FusedPoints.at_full_size(rows[:, :3], normals.astype(np.float32), colours)
