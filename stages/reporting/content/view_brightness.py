"""How bright the albedo of each view is beside that of the others, where they show the same surface."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

FEWEST_VIEWS = 3  # of a vertex: of two that differ, none is the odd one


@dataclass(frozen=True)
class BesideOthers:
    """The albedo of a view beside that of the other views.

    Attributes
    ----------
    stops : float
        How much brighter it is, the median over points.
    spread_stops : float
        How much more or less than that it is from place to place: the median of the absolute difference.
    """

    stops: float
    spread_stops: float


def brightness_beside_others(shown: Sequence[np.ndarray], fewest_points: int) -> list[BesideOthers | None]:
    """Compare each view's brightness with the other views'; None where they share too little.

    Parameters
    ----------
    shown : sequence of ndarray, shape (T,)
        Per view the albedo at the same points of the surface, linear, the mean of its channels; 0 where it
        shows none.
    fewest_points : int
        Shared by a view, else there is no answer.

    Notes
    -----
    Of log2 of the view's value over the median of all views there. One view in many hardly moves a median,
    so the odd one has the whole difference. Small differences come out as 0: at every point with an odd
    number of views one of them is the median itself.
    """
    if not shown:
        return []
    values = np.stack(shown)
    logarithm = np.full(values.shape, np.nan)
    logarithm[values > 0] = np.log2(values[values > 0])
    logarithm[:, (values > 0).sum(axis=0) < FEWEST_VIEWS] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # points and views without any value: nan
        difference = logarithm - np.nanmedian(logarithm, axis=0)
        found = np.nanmedian(difference, axis=1)
        spread = np.nanmedian(np.abs(difference - found[:, None]), axis=1)
    enough = np.isfinite(difference).sum(axis=1) >= fewest_points
    return [
        BesideOthers(float(stops), float(apart)) if known else None
        for stops, apart, known in zip(found, spread, enough, strict=True)
    ]
