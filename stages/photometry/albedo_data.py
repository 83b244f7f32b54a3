"""Observations of the albedo under a known light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

UNLIT = 0.02  # of the median shading: a quotient by less says nothing


@dataclass(frozen=True, eq=False)
class AlbedoData:
    """Of all pixels, view after view; scaled, gains of the views included.

    Attributes
    ----------
    seen : ndarray, shape (N, 3), float32
        The photos without their specular reflection: what albedo and shading are to explain.
    diffuse : ndarray, shape (N, 3), float32
        Without highlights as well, where one light serves all views.
    trusted : ndarray, shape (N,), bool
        Pixels whose data count.
    glossy : float
        How far some materials may be glossy, 0 to 1: they were found, or could not be looked for.
    """

    observed: np.ndarray
    diffuse: np.ndarray
    trusted: np.ndarray
    glossy: float
