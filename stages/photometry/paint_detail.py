"""Where surface is textured, the photo divided by its shading; elsewhere the smooth albedo."""

from __future__ import annotations

import numpy as np

DIM = 0.1  # of the median shading: quotients by less are noise
NOISE = 0.04  # of the logarithm: detail well below is noise, and goes
STRONGEST = 1.0  # of the logarithm: what differs by more (glints, shadows that are not there) is cut to this


def with_detail(
    albedo: np.ndarray, image: np.ndarray, shading: np.ndarray, trusted: np.ndarray, textured: np.ndarray
) -> np.ndarray:
    """Give the albedo, (N, 3), the detail back that the smoothness took, where the surface is textured.

    Notes
    -----
    ``ρ · exp(w r max(0, 1 − (0.04/r)²))`` with ``r = log(I / (ρ S))``, cut to ±1: the photo divided by its
    shading where w is 1, but for what is as small as noise. Only where there is light enough, and data.
    """
    enough = trusted & (shading.mean(axis=1) > DIM * np.median(shading))
    quotient = np.maximum(image, 1e-4) / np.maximum(np.maximum(albedo, 1e-4) * shading, 1e-6)
    left = np.clip(np.log(quotient), -STRONGEST, STRONGEST)
    firm = left * np.maximum(0, 1 - NOISE**2 / np.maximum(left**2, 1e-12))
    share = np.where(enough, textured, 0)[:, None]
    return (np.maximum(albedo, 0) * np.exp(share * firm)).astype(np.float32)
