"""Borders of a depth map, moved inwards to the edges of the photo that stereo has widened them beyond."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import maximum_filter

from stages.geometry.outlines.border_distances import distances_from_border
from stages.stereo.mvs_settings import DepthEdgeSettings

WITHOUT, WITH = 1, 2  # markers: no depth, surely depth


def up_to_edges(
    kept: np.ndarray, even: np.ndarray, image: np.ndarray, how: DepthEdgeSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Take depth from pixels on the far side of an edge of the photo.

    Parameters
    ----------
    kept : ndarray, shape (h, w), bool
        Pixels with depth.
    even : ndarray, shape (h, w), bool
        Pixels whose patch has nothing to match.
    image : ndarray, shape (h, w, 3), uint8
    how : DepthEdgeSettings

    Returns
    -------
    tuple of two ndarray, shape (h, w), bool
        Pixels that keep their depth; pixels of even background, which has none.

    Notes
    -----
    A patch that overlaps an outline before an even background matches where the outline does: depth maps are
    wider than surface by the reach of the patch. Even background is what has no depth, is near what has
    nothing to match, and is connected with the border of the image: what surface encloses is a gap in it.
    Background, and pixels with depth farther from it than that reach, are markers of a watershed (Meyer 1992)
    on the photo's differences between neighbours: what lies between goes to the side from which it is reached
    over the lower ridge. In things too thin to have an inside, the middle is the marker; what is thinner yet
    stays as it is.
    """
    background = _at_border(~kept & _within(even & ~kept, how.reach_px))
    if not how.reach_px or not background.any() or not kept.any():
        return kept, background
    inside_px = distances_from_border(~background)
    middle = (inside_px >= maximum_filter(inside_px, 3)) & (inside_px >= how.thinnest_px / 2)
    markers = np.zeros(kept.shape, np.int32)
    markers[background] = WITHOUT
    markers[kept & ((inside_px > how.reach_px) | middle)] = WITH
    beyond = kept & (_flooded(image, markers) == WITHOUT) & ~_unmarked(kept, markers)
    return kept & ~beyond, background | beyond


def _flooded(image: np.ndarray, markers: np.ndarray) -> np.ndarray:
    """Flood markers over the image, one pixel beyond whose frame OpenCV leaves out."""
    wide = cv2.copyMakeBorder(image, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    return cv2.watershed(wide, np.pad(markers, 1, mode="edge"))[1:-1, 1:-1]


def _unmarked(kept: np.ndarray, markers: np.ndarray) -> np.ndarray:
    """Select the connected parts of pixels with depth that are too thin for any marker: they stay."""
    _, part = cv2.connectedComponents(kept.astype(np.uint8), connectivity=4)
    return ~np.isin(part, part[markers == WITH])


def _at_border(pixels: np.ndarray) -> np.ndarray:
    """Select the connected parts of a mask that reach the border of the image: what is enclosed is a gap."""
    _, part = cv2.connectedComponents(pixels.astype(np.uint8), connectivity=4)
    rim = np.concatenate([part[[0, -1]].ravel(), part[:, [0, -1]].ravel()])
    return np.isin(part, rim[rim > 0])


def _within(pixels: np.ndarray, reach_px: int) -> np.ndarray:
    """Widen a mask by so many pixels, diagonals included."""
    size = 2 * reach_px + 1
    return cv2.dilate(pixels.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
