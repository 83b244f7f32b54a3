"""Where paint changes softly: told by surface that lies evenly in the light, for the relief beside it."""

from __future__ import annotations

from itertools import cycle

import numpy as np

from stages.photometry.albedo.appearance import rise
from stages.photometry.albedo.paint_edges import PaintEdges
from stages.photometry.chromaticity import DARK, NO_SHADING, colour_change
from stages.photometry.neighbourhoods import add_at, means_around, patch_means, patch_side
from stages.photometry.stack import StackedViews

STRONGEST = 0.1  # of the logarithm: a change between neighbours that is no soft one counts as this much
SLOPES = (1.1, 2.2)  # of the logarithm, over a view's side: from no slope to one of paint
SHARES = (0.4, 0.7)  # of the surface around that has such slopes: from here and there to all over
FEW = 0.3  # neighbours of the two, across or down: where fewer lie evenly in the light, they tell little


def soft_paint(
    views: StackedViews, image: np.ndarray, shading: np.ndarray, trusted: np.ndarray, edges: PaintEdges
) -> np.ndarray:
    """0 to 1, of every pixel: paint around it changes softly all over; (N,), float32.

    Parameters
    ----------
    views : StackedViews
    image : ndarray, shape (N, 3)
        Scaled, in white light.
    shading : ndarray, shape (N, 3)
    trusted : ndarray, shape (N,), bool
    edges : PaintEdges
        Their steps of shading and chroma.

    Notes
    -----
    The mean slope of log I/S in a patch, across and down, over neighbours that lie evenly in the light and
    have one colour, each counting by ``exp(−|Δ log S| / s − |Δ chroma|² / c²)``; and the share of the patches
    around that have one. Noise and grain have none, the light errs where the shading changes, and its rims
    and paint's borders are few: one paint has slopes here and there, a marble of greys nearly all over.
    """
    light = np.maximum(shading.mean(axis=1), NO_SHADING)
    lit, quotient = np.log(light), np.log(np.maximum(image.mean(axis=1), 0) / light + DARK)
    change, weight = np.zeros((2, len(image))), np.zeros((2, len(image)))
    for axis, (one, other) in zip(cycle((0, 1)), views.neighbours(), strict=False):
        coloured = colour_change(image[one], image[other]) / edges.chroma_step**2
        even = np.exp(-np.abs(lit[other] - lit[one]) / edges.shading_step - coloured)
        even *= trusted[one] & trusted[other]
        left = even * np.clip(quotient[other] - quotient[one], -STRONGEST, STRONGEST)
        for end in (one, other):
            add_at(change[axis], end, left)
            add_at(weight[axis], end, even)
    across, down = (
        patch_means(views, own) / (patch_means(views, every) + FEW)
        for own, every in zip(change, weight, strict=True)
    )
    slope = rise(np.hypot(across, down) * views.side, SLOPES)
    return rise(means_around(views, slope, 2 * patch_side(views) - 1), SHARES)
