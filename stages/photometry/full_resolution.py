"""The albedo at the photo's own resolution: what is finer than a working pixel comes from the photo."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from stages.scene.resize import reduce_by_area

DARK = 0.02  # of the photo's mean: in darker pixels, detail is noise


def at_full_resolution(
    albedo: np.ndarray, mask: np.ndarray, photo: np.ndarray, kept: np.ndarray, most_contrast: float
) -> tuple[np.ndarray, np.ndarray]:
    """Carry an albedo map to a larger image of the same camera.

    Parameters
    ----------
    albedo : ndarray, shape (h, w, 3), float32
    mask : ndarray, shape (h, w), bool
        Where the albedo is known.
    photo : ndarray, shape (H, W, 3), float32
        Linear; H ≥ h, W ≥ w.
    kept : ndarray, shape (H, W), bool
        Where there is a photo.
    most_contrast : float
        By how much a pixel may differ from its surroundings of a working pixel's size, as a factor.

    Returns
    -------
    tuple of ndarray, shape (H, W, 3), float32, and ndarray, shape (H, W), bool
        The albedo, 0 outside; and where it is known.

    Notes
    -----
    ``ρ↑ · I / (I↓)↑``: ↓ the mean over a working pixel, ↑ bilinear. Light hardly changes within a working
    pixel, so whatever the photo shows there is paint; and an edge of paint, which ρ↑ and (I↓)↑ blur alike, is
    as sharp as in the photo. Outside the mask both go on as at the nearest pixel that lies wholly inside, so
    that no background mixes in. The map itself where the sizes are equal.
    """
    rows, columns = photo.shape[:2]
    if not mask.any():
        return np.zeros_like(photo), np.zeros((rows, columns), bool)
    if mask.shape == (rows, columns):
        return np.where((mask & kept)[..., None], albedo, 0).astype(np.float32), mask & kept
    coarse, inner = reduce_by_area(photo, mask.shape), cv2.erode(mask.astype(np.uint8), np.ones((3, 3))) > 0
    inner = inner if inner.any() else mask
    floor = DARK * max(float(coarse[inner].mean()), 1e-12)
    blurred = _enlarged(_filled(coarse, inner), photo)
    detail = (np.maximum(photo, 0) + floor) / (np.maximum(blurred, 0) + floor)
    fine = _enlarged(_filled(albedo, inner), photo) * np.clip(detail, 1 / most_contrast, most_contrast)
    known = kept & (_enlarged(mask.astype(np.float32), photo) >= 0.5)
    return np.where(known[..., None], fine, 0).astype(np.float32), known


def _enlarged(image: np.ndarray, photo: np.ndarray) -> np.ndarray:
    return cv2.resize(image, (photo.shape[1], photo.shape[0]), interpolation=cv2.INTER_LINEAR)


def _filled(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Outside the mask, the value of the nearest pixel inside."""
    row, column = distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return image[row, column]
