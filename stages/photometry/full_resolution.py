"""The albedo at the photo's own resolution: detail finer than a working pixel is transferred from the photo.

Its share is that of the photo's finest working octave which the albedo contains. Where that octave is not
albedo, as at the border of a shadow or in noise, finer detail is not albedo either.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from stages.formats.images.resize import reduce_by_area
from stages.photometry.full_resolution_settings import FullResolutionSettings


def at_full_resolution(
    albedo: np.ndarray, mask: np.ndarray, photo: np.ndarray, kept: np.ndarray, how: FullResolutionSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Upsample an albedo map to a larger image of the same camera, guided by the photo.

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
    albedo contains all detail of the photo, k is 1, and an edge of albedo, which ρ↑ and (I↓)↑ blur equally,
    is as sharp as in the photo. Outside the mask both are extended from the nearest pixel that lies wholly
    inside, which excludes the background. With equal sizes, the map is returned unchanged inside the mask.
    """
    rows, columns = photo.shape[:2]
    if not mask.any():
        return np.zeros_like(photo), np.zeros((rows, columns), bool)
    if mask.shape == (rows, columns):
        return np.where((mask & kept)[..., None], albedo, 0).astype(np.float32), mask & kept
    coarse = reduce_by_area(photo, mask.shape)
    return with_detail_of(photo, kept, albedo, mask, coarse, lambda image: _enlarged(image, photo), how)


def with_detail_of(
    photo: np.ndarray,
    kept: np.ndarray,
    albedo: np.ndarray,
    mask: np.ndarray,
    coarse: np.ndarray,
    enlarged: Callable[[np.ndarray], np.ndarray],
    how: FullResolutionSettings,
) -> tuple[np.ndarray, np.ndarray]:
    """Upsample an albedo map to the pixels of a photo, of whatever geometry: `at_full_resolution`.

    Parameters
    ----------
    photo : ndarray, shape (H, W, 3), float32
        Linear.
    kept : ndarray, shape (H, W), bool
        Where there is a photo.
    albedo : ndarray, shape (h, w, 3), float32
    mask : ndarray, shape (h, w), bool
        Where the albedo is known; some of it has to be.
    coarse : ndarray, shape (h, w, 3), float32
        The photo at the pixels of the albedo.
    enlarged : callable
        Interpolates a map, (h, w[, c]), at the pixels of the photo: ↑ of the formula; 0 outside the map.
    how : FullResolutionSettings

    Returns
    -------
    tuple of ndarray, shape (H, W, 3), float32, and ndarray, shape (H, W), bool
        The albedo, 0 outside; and where it is known.
    """
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3)))
    thin = mask & (cv2.dilate(inner, np.ones((3, 3))) == 0)  # has no inner pixels of its own
    inner = (inner > 0) | thin
    floor = how.log_offset * max(float(coarse[inner].mean()), 1e-12)
    shown = _filled(coarse, inner)
    blurred = enlarged(shown)
    detail = (np.maximum(photo, 0) + floor) / (np.maximum(blurred, 0) + floor)
    detail = np.clip(detail, 1 / how.most_contrast, how.most_contrast)
    smooth = _filled(albedo, inner)
    share = enlarged(taken_over(smooth, shown, how))
    fine = enlarged(smooth) * detail ** share[..., None]
    known = kept & (enlarged(mask.astype(np.float32)) >= 0.5)
    return np.where(known[..., None], fine, 0).astype(np.float32), known


def taken_over(albedo: np.ndarray, photo: np.ndarray, how: FullResolutionSettings) -> np.ndarray:
    """Measure the share of the photo's finest octave that the albedo contains, around every pixel.

    Parameters
    ----------
    albedo, photo : ndarray, shape (h, w, 3), float32
        Linear.
    how : FullResolutionSettings

    Returns
    -------
    ndarray, shape (h, w), float32
        From 0 to 1: ``(⟨a sign b⟩ + ε)/(⟨|b|⟩ + ε)``, a and b the high-pass of the mean logarithms of albedo
        and photo, below the finest σ; ⟨⟩ the Gaussian mean, ε the least contrast. Magnitudes rather than
        squares limit the influence of a shadow's border on texture beside it.
    """
    a, b = (_finest(image, how) for image in (albedo, photo))
    both, own = (
        cv2.GaussianBlur(part, (0, 0), how.window_px) + how.least_contrast
        for part in (a * np.sign(b), np.abs(b))
    )
    return np.clip(both / own, 0, 1)


def _finest(image: np.ndarray, how: FullResolutionSettings) -> np.ndarray:
    """High-pass the mean over the channels of the offset logarithm."""
    floor = how.log_offset * np.maximum(image.mean(axis=(0, 1)), 1e-12)
    logs = np.log(np.maximum(image, 0) + floor).mean(axis=2).astype(np.float32)
    return logs - cv2.GaussianBlur(logs, (0, 0), how.finest_sigma_px)


def _enlarged(image: np.ndarray, photo: np.ndarray) -> np.ndarray:
    return cv2.resize(image, (photo.shape[1], photo.shape[0]), interpolation=cv2.INTER_LINEAR)


def _filled(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Extend an image beyond its mask by the value of the nearest pixel inside."""
    row, column = distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return image[row, column]
