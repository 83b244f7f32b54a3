"""Selection of trusted pixels: not clipped, on no outline, not seen at a grazing angle, and lit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from stages.photometry.lighting.settings import TrustedPixelSettings
from stages.scene.cameras import Camera, footprint

WHITE = 1.0001  # linear, but for rounding: an image with values beyond has no white point
DIAGONAL_PX = 2 * np.sqrt(2)  # of a pixel and its neighbours


@dataclass(frozen=True, eq=False)
class Viewing:
    """Viewing directions of pixels, and which of them are trusted.

    Attributes
    ----------
    trusted : ndarray, shape (N,), bool
        Pixels whose data count for light and albedo, as far as can be decided without the light.
    towards : ndarray, shape (N, 3), float32
        Unit vectors from the surface to the camera, world axes.
    """

    trusted: np.ndarray
    towards: np.ndarray

    @classmethod
    def of(
        cls, whole: np.ndarray, normals: np.ndarray, towards: np.ndarray, how: TrustedPixelSettings
    ) -> Viewing:
        """Select those of the `whole` pixels, (N,), bool, that are not seen at a grazing angle.

        Whole: clipped in no channel, and on no outline.
        """
        return cls(whole & (np.einsum("nk,nk->n", normals, towards) > how.grazing_cosine), towards)

    def without(self, pixels: np.ndarray) -> Viewing:
        """Exclude pixels, (N,) bool, from the trusted ones, unless none would be left."""
        trusted = self.trusted & ~pixels
        return replace(self, trusted=trusted) if trusted.any() else self


def unclipped(linear: np.ndarray, how: TrustedPixelSettings) -> np.ndarray:
    """Select the pixels of a view, (n, 3), that are clipped in no channel of its photo: (n,), bool.

    A linear image with values beyond 1 has no white point, and nothing in it is clipped.
    """
    if linear.max(initial=0.0) > WHITE:
        return np.ones(len(linear), bool)
    return np.all(linear < how.saturation, axis=1)


def on_outline(
    camera: Camera, mask: np.ndarray, depth: np.ndarray, cosine: np.ndarray, how: TrustedPixelSettings
) -> np.ndarray:
    """Select the pixels of a view beside which the surface ends or another one begins.

    Parameters
    ----------
    camera : Camera
    mask : ndarray, shape (h, w), bool
        N of the pixels.
    depth : ndarray, shape (h, w)
        Along the axis of the camera, model units.
    cosine : ndarray, shape (N,)
        Of the angle between normal and viewing direction, of the masked pixels.
    how : TrustedPixelSettings

    Returns
    -------
    ndarray, shape (N,), bool

    Notes
    -----
    The photo mixes there what is in front with what is behind. The border of the image is no outline;
    surface so thin that all of it would be on one keeps its pixels.
    """
    if not how.outline_px:
        return np.zeros(len(cosine), bool)
    beside = np.ones((3, 3), np.uint8)
    change = (cv2.dilate(depth, beside) - cv2.erode(depth, beside))[mask]
    slope = np.tan(np.arccos(np.clip(cosine, 0, 1))) + how.outline_slope
    inner = cv2.erode(mask.astype(np.uint8), beside)
    inner[mask] &= change <= DIAGONAL_PX * slope * footprint(camera, depth[mask])
    inner = cv2.erode(inner, beside, iterations=how.outline_px - 1)
    return (cv2.dilate(inner, beside, iterations=how.outline_px) > inner)[mask]


def unlit(shading: np.ndarray, typical: float, how: TrustedPixelSettings) -> np.ndarray:
    """Select the pixels with too little shading, (N, 3), to constrain the albedo: (N,), bool.

    `typical`: the median shading of the scene.
    """
    return shading.mean(axis=1) <= how.unlit * typical
