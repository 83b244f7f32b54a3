"""Estimation of light jointly from pairs of equal albedo and from view differences of glossy surface."""

from __future__ import annotations

import numpy as np

from stages.photometry.light_search.light_from_pairs import PairObjective
from stages.photometry.light_search.settings import LightSearchSettings
from stages.photometry.specular.view_differences import InMirror
from stages.solvers.least_squares.non_negative import descend_above_zero


def light_in_gloss(
    pairs: PairObjective,
    mirror: InMirror,
    strength: np.ndarray,
    start: np.ndarray,
    settings: LightSearchSettings,
) -> np.ndarray:
    """Minimise the loss of pairs and the residual of view differences jointly over the light.

    Parameters
    ----------
    pairs : PairObjective
        Of the images without the current estimate of specular reflection.
    mirror : InMirror
        View differences of the glossy surface.
    strength : ndarray, shape (3,)
        Of the mirror.
    start : ndarray, shape (1, M, 3)
    settings : LightSearchSettings
        Used: `specular_light`, and the tolerance of the search.

    Returns
    -------
    ndarray, shape (1, M, 3)
        At least 0.

    Notes
    -----
    The objective is that of `light_from_pairs` plus `residual_weight` times the share of the differences that
    the mirrored light leaves. Pairs determine the light up to a scale, which the differences fix. The
    strength is held constant, so that neither term becomes harder than it is alone.
    """
    how = settings.specular_light

    def objective(light: np.ndarray) -> tuple[float, np.ndarray]:
        loss, slope = pairs(light)
        left, own = mirror.left(strength * light[0])
        weight = how.residual_weight
        return loss + weight * left, slope + weight * strength * own

    return descend_above_zero(objective, start, how.max_steps, settings.search.slope_tolerance)
