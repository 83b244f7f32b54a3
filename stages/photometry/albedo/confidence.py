"""How well each pixel's albedo is known."""

from __future__ import annotations

import numpy as np

from stages.photometry.stack import StackedViews

HALF_LIT = 0.1  # of the median shading: light at which half of the confidence is left
HALF_KNOWN = 0.1  # expected error of the albedo, of itself, at which half of the confidence is left
HALF_OFF = 0.3  # share of the photo that the model leaves unexplained, at which half of it is left


def confidence_of(variance: np.ndarray, trusted: np.ndarray) -> np.ndarray:
    """From 0 (a guess from neighbours and other views) to 1, (N,), float32: ``1/(1 + σ²/0.1²)``.

    Parameters
    ----------
    variance : ndarray, shape (N,)
        σ², expected of the albedo's logarithm.
    trusted : ndarray, shape (N,), bool
        Pixels whose data counted; the others are at 0.
    """
    return np.where(trusted, 1 / (1 + variance / HALF_KNOWN**2), 0).astype(np.float32)


def confidence(
    views: StackedViews,
    image: np.ndarray,
    shading: np.ndarray,
    albedo: np.ndarray,
    incidence: np.ndarray,
    trusted: np.ndarray,
) -> np.ndarray:
    """From 0 (a guess from the neighbourhood) to 1.

    Parameters
    ----------
    views : StackedViews
    image, shading, albedo : ndarray, shape (N, 3)
        Scaled.
    incidence : ndarray, shape (N,)
        Cosine between the normal and the way to the camera.
    trusted : ndarray, shape (N,), bool
        Pixels whose data counted.

    Returns
    -------
    ndarray, shape (N,), float32

    Notes
    -----
    ``v/(v + 1) · cos θ · s/(s + 0.1 median s) · 1/(1 + (r/0.3)²)``: v views that see the point, this one
    included; θ the incidence; s the shading; r what the model leaves unexplained,
    ``2 |I − ρ S| / (I + ρ S)`` over all channels. 0 where the pixel was not trusted.
    """
    seen_by = 1 + views_that_see_it(views)
    light = np.maximum(shading, 0).mean(axis=1)
    typical = max(float(np.median(light)), 1e-12)
    explained = albedo * shading
    off = np.abs(image - explained).sum(axis=1) / np.maximum((image + np.abs(explained)).sum(axis=1), 1e-12)
    value = seen_by / (seen_by + 1) * np.clip(incidence, 0, 1) * light / (light + HALF_LIT * typical)
    return np.where(trusted, value / (1 + (2 * off / HALF_OFF) ** 2), 0).astype(np.float32)


def views_that_see_it(views: StackedViews) -> np.ndarray:
    """How many other views see the surface point of every pixel, (N,).

    A coarse pixel may be linked to many of one view, which counts once.
    """
    count = np.zeros(int(views.starts[-1]), np.int32)
    for (i, j), block in views.links.items():
        count[views.view(i)] += np.diff(block.indptr) > 0
        count[views.view(j)] += np.bincount(block.indices, minlength=block.shape[1]) > 0
    return count
