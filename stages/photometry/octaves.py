"""Octaves of a map: differences of Gaussian means over what is known, from half a pixel to 32."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import cv2
import numpy as np

SIGMAS_PX = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # an octave lies between one and the next, the first below
COARSE = 4.0  # px: Gaussians from here on are taken of a smaller image, a fifth of the time at σ = 32
TINY = 1e-6


def gaussian_mean(values: np.ndarray, weight: np.ndarray, sigma_px: float) -> np.ndarray:
    """Average values under a Gaussian, over what is known of them (normalised convolution).

    Parameters
    ----------
    values : ndarray, shape (h, w) or (h, w, c), float32
        0 where their weight is.
    weight : ndarray, shape (h, w), float32
        0 where nothing is known, else 1.
    sigma_px : float

    Returns
    -------
    ndarray, shape as `values`, float32
        ``(G * (w v)) / (G * w)``; 0 far from all that is known.
    """
    total, known = _smoothed(values, sigma_px), np.maximum(_smoothed(weight, sigma_px), TINY)
    return total / (known if values.ndim == 2 else known[..., None])


def octaves(values: np.ndarray, weight: np.ndarray) -> Iterator[tuple[np.ndarray, float]]:
    """Divide a map into octaves, the finest first, and what is left of it at last.

    Parameters as of `gaussian_mean`.

    Yields
    ------
    tuple of ndarray, shape as `values`, and float
        ``G(σ_{k−1}) − G(σ_k)``, 0 where the weight is, and σ_k in pixels; then ``G(σ_last)`` and infinity.
        Their sum is the map.
    """
    finer = values
    inside = weight > 0
    inside = inside if values.ndim == 2 else inside[..., None]
    for sigma_px in SIGMAS_PX:
        coarser = gaussian_mean(values, weight, sigma_px)
        yield np.where(inside, finer - coarser, 0), sigma_px
        finer = coarser
    yield np.where(inside, finer, 0), np.inf


@cache
def response_to_noise() -> tuple[float, ...]:
    """Standard deviation of each octave of white noise whose standard deviation is 1 in a pixel."""
    side = 2 * int(4 * SIGMAS_PX[-1]) + 1
    impulse = np.zeros((side, side), np.float32)
    impulse[side // 2, side // 2] = 1
    everywhere = np.ones_like(impulse)
    return tuple(
        float(np.sqrt((band**2).sum())) for band, sigma in octaves(impulse, everywhere) if sigma < np.inf
    )


def _smoothed(image: np.ndarray, sigma_px: float) -> np.ndarray:
    """Gaussian of an image that is 0 around itself."""
    if sigma_px < COARSE:
        return cv2.GaussianBlur(image, (0, 0), sigma_px, borderType=cv2.BORDER_CONSTANT)
    height, width = image.shape[:2]
    factor = 2 ** int(np.log2(sigma_px / 2))
    padded = cv2.copyMakeBorder(image, 0, -height % factor, 0, -width % factor, cv2.BORDER_CONSTANT)
    size = padded.shape[1] // factor, padded.shape[0] // factor
    small = cv2.resize(padded, size, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma_px / factor, borderType=cv2.BORDER_CONSTANT)
    large = cv2.resize(small, padded.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return large[:height, :width]
