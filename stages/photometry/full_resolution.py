"""The albedo at the photo's own resolution: what is finer than a working pixel comes from the photo.

As far as the albedo has what the photo shows just above a working pixel: where it has not, at the rim of a
shadow or where there is noise alone, what is finer still is no more albedo than that.
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from stages.formats.images.resize import reduce_by_area
from stages.photometry.full_resolution_settings import FullResolutionSettings


def at_full_resolution(
    albedo: np.ndarray, mask: np.ndarray, photo: np.ndarray, kept: np.ndarray, how: FullResolutionSettings
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
    how : FullResolutionSettings

    Returns
    -------
    tuple of ndarray, shape (H, W, 3), float32, and ndarray, shape (H, W), bool
        The albedo, 0 outside; and where it is known.

    Notes
    -----
    ``ρ↑ · (I / (I↓)↑)^(k↑)``: ↓ the mean over a working pixel, ↑ bilinear, k of `taken_over`. Where the
    albedo has all that the photo shows, k is 1, and an edge of albedo, which ρ↑ and (I↓)↑ blur alike, is as
    sharp as in the photo. Outside the mask both go on as at the nearest pixel that lies wholly inside, so
    that no background mixes in. The map itself where the sizes are equal.
    """
    rows, columns = photo.shape[:2]
    if not mask.any():
        return np.zeros_like(photo), np.zeros((rows, columns), bool)
    if mask.shape == (rows, columns):
        return np.where((mask & kept)[..., None], albedo, 0).astype(np.float32), mask & kept
    coarse, inner = reduce_by_area(photo, mask.shape), cv2.erode(mask.astype(np.uint8), np.ones((3, 3))) > 0
    inner = inner if inner.any() else mask
    floor = how.log_offset * max(float(coarse[inner].mean()), 1e-12)
    shown = _filled(coarse, inner)
    blurred = _enlarged(shown, photo)
    detail = (np.maximum(photo, 0) + floor) / (np.maximum(blurred, 0) + floor)
    detail = np.clip(detail, 1 / how.most_contrast, how.most_contrast)
    smooth = _filled(albedo, inner)
    share = _enlarged(taken_over(smooth, shown, how), photo)
    fine = _enlarged(smooth, photo) * detail ** share[..., None]
    known = kept & (_enlarged(mask.astype(np.float32), photo) >= 0.5)
    return np.where(known[..., None], fine, 0).astype(np.float32), known


def taken_over(albedo: np.ndarray, photo: np.ndarray, how: FullResolutionSettings) -> np.ndarray:
    """Measure how much an albedo has of what the photo shows in its finest octave, around every pixel.

    Parameters
    ----------
    albedo, photo : ndarray, shape (h, w, 3), float32
        Linear.
    how : FullResolutionSettings

    Returns
    -------
    ndarray, shape (h, w), float32
        From 0 to 1: ``(⟨a sign b⟩ + ε)/(⟨|b|⟩ + ε)``, a and b what is finer than the finest σ of the mean
        logarithms of albedo and photo, ⟨⟩ the mean around a pixel, ε the least contrast. By sizes
        rather than squares, so that the rim of a shadow takes little of the texture beside it along.
    """
    a, b = (_finest(image, how) for image in (albedo, photo))
    both, own = (
        cv2.GaussianBlur(part, (0, 0), how.window_px) + how.least_contrast
        for part in (a * np.sign(b), np.abs(b))
    )
    return np.clip(both / own, 0, 1)


def _finest(image: np.ndarray, how: FullResolutionSettings) -> np.ndarray:
    """Filter the finest part out of the logarithm's mean over the channels; dark pixels hardly differ."""
    floor = how.log_offset * np.maximum(image.mean(axis=(0, 1)), 1e-12)
    logs = np.log(np.maximum(image, 0) + floor).mean(axis=2).astype(np.float32)
    return logs - cv2.GaussianBlur(logs, (0, 0), how.finest_sigma_px)


def _enlarged(image: np.ndarray, photo: np.ndarray) -> np.ndarray:
    return cv2.resize(image, (photo.shape[1], photo.shape[0]), interpolation=cv2.INTER_LINEAR)


def _filled(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Fill in, outside the mask, the value of the nearest pixel inside."""
    row, column = distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return image[row, column]
