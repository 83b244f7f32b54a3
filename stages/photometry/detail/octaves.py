"""Octaves of maps: differences of Gaussian means over what is known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from stages.formats.artefacts.view_files import image_of
from stages.photometry.stack import StackedViews

COARSE = 4.0  # px: Gaussians from here on are taken of a smaller image, to 3 %, a fifth of the time at σ = 32
TINY = 1e-6  # against division by 0


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


@dataclass(frozen=True, eq=False)
class KnownPixels:
    """Pixels of stacked views of which something is known.

    Attributes
    ----------
    masks : sequence of ndarray, shape (h_i, w_i), bool
    starts : ndarray, shape (n + 1,)
        View i owns the places ``starts[i]:starts[i + 1]`` of what is stacked.
    known : ndarray, shape (N,), bool
    """

    masks: Sequence[np.ndarray]
    starts: np.ndarray
    known: np.ndarray

    @classmethod
    def of(cls, views: StackedViews, known: np.ndarray) -> KnownPixels:
        """Take the masks from the views."""
        return cls(views.masks, views.starts, known)

    def mean(self, values: np.ndarray, sigma_px: float) -> np.ndarray:
        """Average what is stacked, (N,) or (N, c), under a Gaussian in each view; float32."""
        out = np.empty(values.shape, np.float32)
        for mask, begin, end in zip(self.masks, self.starts[:-1], self.starts[1:], strict=True):
            weight = image_of(mask, self.known[begin:end].astype(np.float32))
            own = image_of(mask, values[begin:end].astype(np.float32))
            own *= weight if own.ndim == 2 else weight[..., None]
            out[begin:end] = gaussian_mean(own, weight, sigma_px)[mask]
        return out

    def octaves(self, values: np.ndarray, sigmas_px: tuple[float, ...]) -> Iterator[tuple[np.ndarray, float]]:
        """Divide what is stacked, (N,) or (N, c), into octaves, the finest first, and what is left at last.

        Parameters
        ----------
        values : ndarray
        sigmas_px : tuple of float
            Ascending: an octave lies between one and the next, the first below.

        Yields
        ------
        tuple of ndarray, shape as `values`, float32, and float
            ``G(σ_{k−1}) − G(σ_k)``, 0 where nothing is known, and σ_k in pixels; then ``G(σ_last)`` and
            infinity. Their sum is what is known of the values.
        """
        known = self.known if values.ndim == 1 else self.known[:, None]
        finer = values.astype(np.float32)
        for sigma_px in sigmas_px:
            coarser = self.mean(values, sigma_px)
            yield np.where(known, finer - coarser, 0), sigma_px
            finer = coarser
        yield np.where(known, finer, 0), np.inf


@cache
def response_to_noise(sigmas_px: tuple[float, ...]) -> tuple[float, ...]:
    """Compute the standard deviation of each octave of white noise that has 1 in a pixel."""
    side = 2 * int(4 * sigmas_px[-1]) + 1
    everywhere = np.ones((side, side), bool)
    impulse = np.zeros(side**2, np.float32)
    impulse[side**2 // 2] = 1
    pixels = KnownPixels((everywhere,), np.array([0, side**2]), everywhere.ravel())
    bands = pixels.octaves(impulse, sigmas_px)
    return tuple(float(np.sqrt((band**2).sum())) for band, sigma_px in bands if sigma_px < np.inf)


def _smoothed(image: np.ndarray, sigma_px: float) -> np.ndarray:
    """Blur an image that is 0 around itself by a Gaussian."""
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
