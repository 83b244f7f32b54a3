"""Resampling of images to another camera at the same place."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np

from stages.scene.cameras import pixel_centres, xy_for_integer_centres

# Working rows resampled at a time: bounds the memory of a view, whatever its size.
BAND_ROWS = 64

# Share of a sample's light that must come from kept pixels: all, but for the rounding of coordinates.
ALL_KEPT = 0.999

# From pixel coordinates (n, 2) of the wanted image to those of the given one, both with centres at 0.5.
SourceFromTarget = Callable[[np.ndarray], np.ndarray]


def oversampling(source_focal_px: float, target_focal_px: float) -> int:
    """Count samples per target pixel and axis that leave out no source pixel: the ratio of focal lengths."""
    return max(1, math.ceil(source_focal_px / target_focal_px - 1e-6))


def resample(
    linear: np.ndarray,
    kept: np.ndarray,
    size: tuple[int, int],
    source_from_target: SourceFromTarget,
    samples: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Resample an image: bilinear at an integer multiple of the wanted size, then the mean of each block.

    On **linear** light, for only light averages: COLMAP's undistorter resamples 8-bit sRGB, which darkens
    edges and rounds.

    Parameters
    ----------
    linear : ndarray, shape (h, w, 3), float32
        Linear RGB.
    kept : ndarray, shape (h, w), bool
        Pixels that may be used.
    size : tuple of int
        Width and height wanted.
    source_from_target : callable
        Where each wanted pixel lies in `linear`.
    samples : int
        Per wanted pixel and axis: `oversampling`.

    Returns
    -------
    linear : ndarray, shape (height, width, 3), float32
    kept : ndarray, shape (height, width), bool
        True where every sample lies inside the image and between kept pixels only: the pixel is their mean.
    """
    width, height = size
    kept_share = kept.astype(np.float32)
    out = np.empty((height, width, 3), np.float32)
    out_kept = np.empty((height, width), bool)
    for top in range(0, height, BAND_ROWS):
        rows = min(BAND_ROWS, height - top)
        xy = source_from_target(_sample_grid(width, rows, top, samples)).reshape(
            rows * samples, width * samples, 2
        )
        band, band_kept = _sample(linear, kept_share, xy)
        out[top : top + rows] = _block_mean(band, samples)
        blocks = band_kept.reshape(rows, samples, width, samples)
        out_kept[top : top + rows] = blocks.all(axis=(1, 3))
    return out, out_kept


def bilinear(image: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Interpolate an image at other pixels' places.

    Parameters
    ----------
    image : ndarray, shape (h, w[, c]), float32
    xy : ndarray, shape (H, W, 2), float32
        Pixels of `image`, centres at 0.5; NaN where there is nothing to see.

    Returns
    -------
    ndarray, shape (H, W[, c]), float32
        0 outside the image.
    """
    height, width = image.shape[:2]
    out = np.empty((*xy.shape[:2], *image.shape[2:]), np.float32)
    for top in range(0, len(xy), BAND_ROWS):
        x, y = np.moveaxis(xy[top : top + BAND_ROWS], -1, 0)
        inside = _inside(x, y, width, height)
        column, row = (np.where(inside, xy_for_integer_centres(v), 0).astype(np.float32) for v in (x, y))
        values = cv2.remap(image, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        values[~inside] = 0
        out[top : top + BAND_ROWS] = values
    return out


def _sample_grid(width: int, rows: int, top: int, samples: int) -> np.ndarray:
    """Sample positions of a band of pixels, shape (n, 2), in pixels of the wanted image."""
    return (pixel_centres(width * samples, rows * samples) / samples + [0, top]).reshape(-1, 2)


def _sample(linear: np.ndarray, kept_share: np.ndarray, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bilinear values and whether they may be used, at coordinates (h, w, 2) with centres at 0.5."""
    height, width = kept_share.shape
    x, y = xy[..., 0], xy[..., 1]
    inside = _inside(x, y, width, height)
    column, row = (np.where(inside, xy_for_integer_centres(v), 0).astype(np.float32) for v in (x, y))
    values, shares = (
        cv2.remap(image, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for image in (linear, kept_share)
    )
    values[~inside] = 0
    return values, inside & (shares > ALL_KEPT)


def _inside(x: np.ndarray, y: np.ndarray, width: int, height: int) -> np.ndarray:
    """Test which coordinates lie in an image; NaN does not."""
    with np.errstate(invalid="ignore"):
        inside: np.ndarray = (x >= 0) & (x <= width) & (y >= 0) & (y <= height)
    return inside


def _block_mean(image: np.ndarray, samples: int) -> np.ndarray:
    """Mean of samples × samples blocks, shape (h·s, w·s, 3) to (h, w, 3)."""
    size = image.shape[1] // samples, image.shape[0] // samples
    return image if samples == 1 else cv2.resize(image, size, interpolation=cv2.INTER_AREA)
