"""Confidence of the albedo per pixel, 0 to 1."""

from __future__ import annotations

import numpy as np

from stages.photometry.albedo.settings import ConfidenceSettings
from stages.photometry.stack import StackedViews


def confidence_of(variance: np.ndarray, trusted: np.ndarray, how: ConfidenceSettings) -> np.ndarray:
    """Compute confidence from the expected error, (N,), float32: ``1/(1 + σ²/h²)``, h the half error.

    Parameters
    ----------
    variance : ndarray, shape (N,)
        σ², expected variance of the log albedo.
    trusted : ndarray, shape (N,), bool
        Pixels with valid data; the others, filled in from neighbours and other views, have confidence 0.
    how : ConfidenceSettings
    """
    return np.where(trusted, 1 / (1 + variance / how.half_error**2), 0).astype(np.float32)


def confidence(
    views: StackedViews,
    image: np.ndarray,
    shading: np.ndarray,
    albedo: np.ndarray,
    incidence: np.ndarray,
    trusted: np.ndarray,
    how: ConfidenceSettings,
) -> np.ndarray:
    """Compute confidence from visibility, incidence, shading and residual, without an expected error.

    Parameters
    ----------
    views : StackedViews
    image, shading, albedo : ndarray, shape (N, 3)
        Scaled.
    incidence : ndarray, shape (N,)
        Cosine between the normal and the direction to the camera.
    trusted : ndarray, shape (N,), bool
        Pixels with valid data.
    how : ConfidenceSettings

    Returns
    -------
    ndarray, shape (N,), float32
        0 (filled in from the neighbourhood) to 1.

    Notes
    -----
    ``v/(v + 1) · cos θ · s/(s + h median s) · 1/(1 + (r/q)²)``: v the number of views of the point, this one
    included; θ the incidence; s the shading, h its half value; r the relative residual,
    ``2 |I − ρ S| / (I + ρ S)`` over all channels, q its half value. 0 in untrusted pixels.
    """
    seen_by = 1 + views_that_see_it(views)
    light = np.maximum(shading, 0).mean(axis=1)
    typical = max(float(np.median(light)), 1e-12)
    explained = albedo * shading
    off = np.abs(image - explained).sum(axis=1) / np.maximum((image + np.abs(explained)).sum(axis=1), 1e-12)
    value = seen_by / (seen_by + 1) * np.clip(incidence, 0, 1) * light / (light + how.half_shading * typical)
    return np.where(trusted, value / (1 + (2 * off / how.half_residual) ** 2), 0).astype(np.float32)


def views_that_see_it(views: StackedViews) -> np.ndarray:
    """Count the other views that see the surface point of every pixel, (N,).

    A coarse pixel may correspond to several pixels of one view, which counts once.
    """
    count = np.zeros(int(views.starts[-1]), np.int32)
    for (i, j), block in views.correspondences.items():
        count[views.view(i)] += np.diff(block.indptr) > 0
        count[views.view(j)] += np.bincount(block.indices, minlength=block.shape[1]) > 0
    return count
