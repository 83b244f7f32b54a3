"""Observations of the albedo under a known light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BY_PIXEL = ("observed", "diffuse", "trusted", "clipped")  # of `AlbedoData`


@dataclass(frozen=True, eq=False)
class AlbedoData:
    """Observations of all pixels, view after view; scaled, gains of the views included.

    Attributes
    ----------
    observed : ndarray, shape (N, 3), float32
        The photos without the estimated specular reflection, to be explained by albedo and shading.
    diffuse : ndarray, shape (N, 3), float32
        Without highlights as well, where all views share one light.
    trusted : ndarray, shape (N,), bool
        Pixels with valid data.
    clipped : ndarray, shape (N,), bool
        Pixels whose radiance was larger than observed.
    glossy : float
        Degree to which materials may be glossy, 0 to 1: they were detected, or could not be.
    """

    observed: np.ndarray
    diffuse: np.ndarray
    trusted: np.ndarray
    clipped: np.ndarray
    glossy: float

    def by_pixel(self) -> dict[str, np.ndarray]:
        """List what every pixel has, by name: `BY_PIXEL`."""
        return {kind: getattr(self, kind) for kind in BY_PIXEL}


def typical_light_of(shading: np.ndarray) -> float:
    """Compute the median of the channels' mean, of shading (N, 3)."""
    return float(np.median(np.maximum(shading.mean(axis=1), 0)))
