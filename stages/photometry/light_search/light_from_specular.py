"""The light of glossy surface: the one by which like paint comes out alike, and views differ as they do."""

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
    """Descend from a light to one that both kinds of witnesses agree on.

    Parameters
    ----------
    pairs : PairObjective
        Of what is seen without specular reflection, as it is known so far.
    mirror : InMirror
        How views of the glossy surface differ.
    strength : ndarray, shape (3,)
        Of the mirror.
    start : ndarray, shape (1, M, 3)
    settings : LightSearchSettings
        Of which `specular_light`, and the tolerance of the search.

    Returns
    -------
    ndarray, shape (1, M, 3)
        At least 0.

    Notes
    -----
    Adds `residual_weight` times what the light in the mirror leaves of the differences to what
    `light_from_pairs` minimises. Pairs know the light up to a scale, which the differences choose: the
    strength is held, and both stay as easy as they are alone.
    """
    how = settings.specular_light

    def objective(light: np.ndarray) -> tuple[float, np.ndarray]:
        loss, slope = pairs(light)
        left, own = mirror.left(strength * light[0])
        weight = how.residual_weight
        return loss + weight * left, slope + weight * strength * own

    return descend_above_zero(objective, start, how.max_steps, settings.search.slope_tolerance)
