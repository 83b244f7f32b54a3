"""Albedo where photos are clipped: at least what they show."""

from __future__ import annotations

import numpy as np

from stages.photometry.albedo.settings import ClippedSettings
from stages.photometry.specular.linked_kernels import count_linked
from stages.photometry.stack import StackedViews


def raised_where_clipped(
    views: StackedViews,
    albedo: np.ndarray,
    image: np.ndarray,
    light: np.ndarray,
    clipped: np.ndarray,
    how: ClippedSettings,
) -> np.ndarray:
    """Raise the albedo of clipped pixels to what their photos show at least, where other views agree.

    Parameters
    ----------
    views : StackedViews
    albedo : ndarray, shape (N, 3), float32
        Of clipped pixels, inferred from their neighbours.
    image, light : ndarray, shape (N, 3)
        Radiance and shading; the light is above 0.
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
    alike, linked = np.zeros(len(clipped), np.int32), np.zeros(len(clipped), np.int32)
    everywhere = np.ones(len(clipped), bool)
    for pair in views.linked_rows():
        count_linked(*pair, clipped, alike)
        count_linked(*pair, everywhere, linked)
    paint = np.flatnonzero(clipped & (linked > 0) & (alike >= how.agreeing_share * linked))
    raised = albedo.copy()
    raised[paint] = np.maximum(albedo[paint], image[paint] / light[paint])
    return raised
