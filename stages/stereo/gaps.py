"""Gaps of a cloud, closed by stereo at smaller sizes: even surface matches only in larger patches."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import cv2
import numpy as np
from scipy.spatial import cKDTree

from stages.scene.cameras import Camera, pixels_of, smallest_footprints
from stages.stereo.depth.fusion import FusedPoints
from stages.stereo.mvs_settings import GapSettings


def scales_of(cameras: Iterable[Camera], how: GapSettings) -> list[float]:
    """List the scales at which stereo is done: 1, then halves while images have `least_px`."""
    longest, scales = max(max(camera.shape) for camera in cameras), [1.0]
    while longest * scales[-1] / 2 >= how.least_px:
        scales.append(scales[-1] / 2)
    return scales


def with_gaps_closed(
    fine: FusedPoints,
    coarse: FusedPoints,
    cameras: list[Camera],
    depth_of: Callable[[int], np.ndarray],
    how: GapSettings,
    threads: int,
) -> FusedPoints:
    """Add coarse points to a fine cloud where it has none, unless a fine depth map looks through them.

    Parameters
    ----------
    fine, coarse : FusedPoints
    cameras : list of Camera
        At the size of the fine depth maps.
    depth_of : callable
        From the number of a camera to its depth map, (h, w): z, 0 where unknown.
    how : GapSettings
    threads : int
        Never changes the result.

    Notes
    -----
    Large patches also widen what is in front of a depth edge. There, in front of surface that the fine depth
    maps have confirmed, space is known to be free.
    """
    if not len(fine.x_in_world) or not len(coarse.x_in_world):
        return fine if len(fine.x_in_world) else coarse
    distance, _ = cKDTree(fine.x_in_world).query(coarse.x_in_world, workers=threads)
    kept = distance > how.reach_footprints * smallest_footprints(coarse.x_in_world, cameras)
    missing = np.flatnonzero(kept)
    missing = missing[~_in_free_space(coarse.x_in_world[missing], cameras, depth_of, how.behind)]
    return FusedPoints.joined([fine, coarse.chosen(missing)])


def without_surface(background: np.ndarray, coarse_kept: np.ndarray, reach_px: float) -> np.ndarray:
    """Take from the even background of a view what has depth at a smaller size.

    Parameters
    ----------
    background : ndarray, shape (h, w), bool
    coarse_kept : ndarray, bool
        Pixels of the smaller size that have depth.
    reach_px : float
        How far depth at the smaller size may reach beyond an outline, in pixels of `background`. What is no
        wider than two such rims stays background.

    Returns
    -------
    ndarray, shape (h, w), bool
    """
    surface = cv2.resize(
        coarse_kept.astype(np.uint8), background.shape[::-1], interpolation=cv2.INTER_NEAREST
    )
    size = 2 * int(np.ceil(reach_px)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return background & (cv2.morphologyEx(surface * background, cv2.MORPH_OPEN, disc) == 0)


def _in_free_space(
    x_in_world: np.ndarray, cameras: list[Camera], depth_of: Callable[[int], np.ndarray], behind: float
) -> np.ndarray:
    """Test whether a depth map shows surface behind each point, by more than a share of its depth; (n,)."""
    free = np.zeros(len(x_in_world), bool)
    for view, camera in enumerate(cameras):
        inside, pixel, z = pixels_of(camera, x_in_world)
        if inside.size:
            free[inside] |= depth_of(view)[pixel] > (1 + behind) * z
    return free
