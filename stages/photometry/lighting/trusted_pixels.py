"""Selection of trusted pixels: not clipped, not seen at a grazing angle, and lit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stages.photometry.lighting.settings import TrustedPixelSettings

WHITE = 1.0001  # linear, but for rounding: an image with values beyond has no white point


@dataclass(frozen=True, eq=False)
class Viewing:
    """Viewing directions of pixels, and which of them are trusted.

    Attributes
    ----------
    trusted : ndarray, shape (N,), bool
        Pixels whose data count for light and albedo, as far as can be decided without the light.
    towards : ndarray, shape (N, 3), float32
        Unit vectors from the surface to the camera, world axes.
    clipped : ndarray, shape (N,), bool
        Pixels of the others that are clipped.
    """

    trusted: np.ndarray
    towards: np.ndarray
    clipped: np.ndarray

    @classmethod
    def of(
        cls, unclipped: np.ndarray, normals: np.ndarray, towards: np.ndarray, how: TrustedPixelSettings
    ) -> Viewing:
        """Select those of the `unclipped` pixels, (N,), bool, that are not seen at a grazing angle."""
        facing = np.einsum("nk,nk->n", normals, towards) > how.grazing_cosine
        return cls(unclipped & facing, towards, ~unclipped)

    def without(self, pixels: np.ndarray) -> Viewing:
        """Exclude pixels, (N,) bool, from the trusted ones, unless none would be left."""
        trusted = self.trusted & ~pixels
        return replace(self, trusted=trusted) if trusted.any() else self


def unclipped(linear: np.ndarray, how: TrustedPixelSettings, has_white: bool = False) -> np.ndarray:
    """Select the pixels of a view, (n, 3), that are clipped in no channel of its photo: (n,), bool.

    A linear image with values beyond 1 has no white point, and nothing in it is clipped; unless it is said to
    have one: saturated colours of a wider gamut than sRGB's are beyond it as well.
    """
    if not has_white and linear.max(initial=0.0) > WHITE:
        return np.ones(len(linear), bool)
    return np.all(linear < how.saturation, axis=1)


def unlit(shading: np.ndarray, typical: float, how: TrustedPixelSettings) -> np.ndarray:
    """Select the pixels with too little shading, (N, 3), to constrain the albedo: (N,), bool.

    `typical`: the median shading of the scene.
    """
    return shading.mean(axis=1) <= how.unlit * typical
