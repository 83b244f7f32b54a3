"""Octave bands of log brightness and of chroma inside a mask: differences of Gaussians."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

BRIGHTNESS, CHROMA = slice(0, 1), slice(1, 3)  # channels of `log_signals`
KERNEL_RADII = 4  # a Gaussian is cut at this many σ, where it has fallen to 3e-4 of its peak


@dataclass(frozen=True)
class BandSettings:
    """Numbers that define the measure; figures are comparable only between reports that share them.

    Attributes
    ----------
    sigmas_px : tuple of float
        Bounds of the octaves: band k is ``G(σ_k) − G(σ_k+1)``. From the finest detail of a pixel grid to
        the width of a shadow's edge.
    erosion_px : int
        Erosion of the mask before statistics: pixels at silhouettes mix object and background.
    floor_quantile, floor_share : float
        Values below this share of this quantile are clamped to it before the logarithm: below a hundredth of
        white one step of 8-bit sRGB is 6 % and more, so that a logarithm would show only rounding. The
        quantile makes the floor robust to a few highlights.
    least_rms : float
        Natural log units. Weaker bands serve as no reference: one step of 8-bit sRGB is nowhere below 0.9 %,
        and a ratio to a ninth of that would show only rounding.
    shading_share : float
        Without truth: local band of the shading over that of the photo, below which a pixel is counted.
    """

    sigmas_px: tuple[float, ...] = (1, 2, 4, 8, 16, 32)
    erosion_px: int = 4
    floor_quantile: float = 0.99
    floor_share: float = 0.01
    least_rms: float = 1e-3
    shading_share: float = 1 / 3

    @property
    def octaves(self) -> tuple[tuple[float, float], ...]:
        """Pairs (σ_low, σ_high), pixels."""
        return tuple(zip(self.sigmas_px[:-1], self.sigmas_px[1:], strict=True))


BANDS = BandSettings()


def log_floors(values: np.ndarray, settings: BandSettings = BANDS) -> np.ndarray:
    """Compute the least values of which logarithms are taken: of brightness, red, green and blue.

    ``floor_share · quantile(floor_quantile)`` over the masked pixels of all views together. Floors scale with
    the values; where they are not positive they are 1, so that a black channel is constant.

    Parameters
    ----------
    values : ndarray, shape (N, 3)
        Linear.

    Returns
    -------
    ndarray, shape (4,), float64
    """
    if not len(values):
        return np.ones(4)
    four = (values.mean(axis=1, dtype=np.float64), *values.T)
    high = np.array([np.quantile(one, settings.floor_quantile) for one in four], np.float64)
    return np.where(high > 0, settings.floor_share * high, 1.0)


def log_signals(image: np.ndarray, mask: np.ndarray, floors: np.ndarray) -> np.ndarray:
    """Take logarithms: brightness, and chroma as two opponent ratios.

    ``log max((R+G+B)/3, f₀)``, ``log max(R, f₁) − log max(G, f₂)``, ``log max(B, f₃) − log max(G, f₂)``.

    Parameters
    ----------
    image : ndarray, shape (h, w, 3)
        Linear; not read outside the mask.
    mask : ndarray, shape (h, w), bool
    floors : ndarray, shape (4,)
        f, as `log_floors` gives it.

    Returns
    -------
    ndarray, shape (h, w, 3), float32
        0 outside the mask.
    """
    values = image[mask].astype(np.float64)
    brightness = np.log(np.maximum(values.mean(axis=1), floors[0]))
    red, green, blue = np.log(np.maximum(values, floors[1:])).T
    signals = np.zeros((*mask.shape, 3), np.float32)
    signals[mask] = np.stack([brightness, red - green, blue - green], axis=1)
    return signals


def smooth_inside(signals: np.ndarray, mask: np.ndarray, sigma_px: float) -> np.ndarray:
    """Filter by a Gaussian inside a mask, by normalised convolution (Knutsson & Westin 1993).

    ``(G_σ ∗ (m·f)) / (G_σ ∗ m)``: the mean of the masked neighbours under the Gaussian's weights;
    pixels outside the mask or beyond the frame have no weight. Constants are preserved.

    Parameters
    ----------
    signals : ndarray, shape (h, w, c), float32
        f; finite inside the mask.
    mask : ndarray, shape (h, w), bool
        m.

    Returns
    -------
    ndarray, shape (h, w, c), float32
        0 outside the mask.
    """
    inside = mask[..., None]
    stacked = np.concatenate([np.where(inside, signals, 0), inside], axis=-1, dtype=np.float32)
    side = 2 * int(np.ceil(KERNEL_RADII * sigma_px)) + 1
    blurred = cv2.GaussianBlur(stacked, (side, side), sigma_px, borderType=cv2.BORDER_CONSTANT)
    return np.divide(
        blurred[..., :-1], blurred[..., -1:], out=np.zeros(signals.shape, np.float32), where=inside
    )


def octave_bands(
    signals: np.ndarray, mask: np.ndarray, settings: BandSettings = BANDS
) -> Iterator[np.ndarray]:
    """Split signals into octaves, finest first: ``b_k = G(σ_k) ∗ f − G(σ_k+1) ∗ f`` inside the mask.

    Parameters
    ----------
    signals : ndarray, shape (h, w, c), float32
    mask : ndarray, shape (h, w), bool

    Yields
    ------
    ndarray, shape (h, w, c), float32
        One band for each of ``settings.octaves``; 0 outside the mask.

    Notes
    -----
    Within about σ_k+1 of an edge of the mask or of the frame the means are one-sided, so that a linear slope
    gives a non-zero band there, equally in all maps that are compared.
    """
    fine = smooth_inside(signals, mask, settings.sigmas_px[0])
    for sigma in settings.sigmas_px[1:]:
        coarse = smooth_inside(signals, mask, sigma)
        yield fine - coarse
        fine = coarse


def eroded(mask: np.ndarray, pixels: int) -> np.ndarray:
    """Erode a mask by `pixels`, shape (h, w), bool; the frame is no edge."""
    side = 2 * pixels + 1
    return cv2.erode(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
