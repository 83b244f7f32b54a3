"""Albedo where photos are clipped: at least what they show."""

from __future__ import annotations

import numpy as np

from stages.photometry.albedo.settings import ClippedSettings
from stages.photometry.detail.other_views import OtherViews
from stages.photometry.stack import StackedViews


def raised_where_clipped(
    views: StackedViews,
    albedo: np.ndarray,
    image: np.ndarray,
    shading: np.ndarray,
    least_light: float,
    clipped: np.ndarray,
    how: ClippedSettings,
) -> np.ndarray:
    """Raise the albedo of clipped pixels to what their photos show at least, where other views agree.

    Parameters
    ----------
    views : StackedViews
    albedo : ndarray, shape (N, 3), float32
        Of clipped pixels, inferred from their neighbours.
    image, shading : ndarray, shape (N, 3)
    least_light : float
        Shading that the image is divided by at least; above 0.
    clipped : ndarray, shape (N,), bool
    how : ClippedSettings

    Returns
    -------
    ndarray, shape (N, 3), float32

    Notes
    -----
    A clipped value is a lower bound of the radiance, and so of albedo times shading, unless it is that of a
    highlight. Highlights move over the surface from view to view; bright paint is clipped in most of them.
    """
    if not clipped.any():
        return albedo.copy()
    others = OtherViews.of(views, np.ones(len(clipped), bool))
    agreeing = others.mean(clipped[:, None])[:, 0] >= how.agreeing_share
    paint = np.flatnonzero(clipped & agreeing & (others.correspondences > 0))
    raised = albedo.copy()
    raised[paint] = np.maximum(albedo[paint], image[paint] / np.maximum(shading[paint], least_light))
    return raised
