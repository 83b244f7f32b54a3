"""Distances of pixels from the border of a region."""

from __future__ import annotations

import cv2
import numpy as np


def distances_from_border(region: np.ndarray) -> np.ndarray:
    """Compute how far each pixel of a region is from the nearest pixel outside, in pixels.

    Parameters
    ----------
    region : ndarray, shape (h, w), bool

    Returns
    -------
    ndarray, shape (h, w), float32
        Between centres, so at least 1 within the region; 0 outside. The frame of the image is no border.

    Notes
    -----
    OpenCV's exact distances differ in their last digit with where the system put the array. Squares are whole
    numbers, so that rounding them gives the same distances each time, and equal ones where they are equal.
    """
    nearly = cv2.distanceTransform(region.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.sqrt(np.rint(np.square(nearly, dtype=np.float64))).astype(np.float32)
