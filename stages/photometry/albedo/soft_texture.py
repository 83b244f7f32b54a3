"""Albedo that varies gradually all over: detected on evenly lit surface, for the relief around it."""

from __future__ import annotations

from itertools import cycle

import numpy as np

from stages.photometry.albedo.appearance import rise
from stages.photometry.albedo.settings import EdgeSettings
from stages.photometry.chromaticity import DARK, NO_SHADING, colour_change
from stages.photometry.neighbourhoods import add_at, means_around, patch_means, patch_side
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.pixelwise import on_threads
from stages.solvers.least_squares.difference_operators import Pixels


def soft_texture(
    views: StackedViews, image: np.ndarray, shading: np.ndarray, trusted: np.ndarray, how: EdgeSettings
) -> np.ndarray:
    """Measure the degree to which the albedo around every pixel varies gradually, 0 to 1; (N,), float32.

    Parameters
    ----------
    views : StackedViews
    image : ndarray, shape (N, 3)
        Scaled, in white light.
    shading : ndarray, shape (N, 3)
    trusted : ndarray, shape (N,), bool
    how : EdgeSettings
        `shading_step`, `chroma_step` and `soft_texture` are used.

    Notes
    -----
    The mean slope of log I/S in a patch, across and down, over evenly lit neighbours of equal colour, each
    weighted by ``exp(−|Δ log S| / s − |Δ chroma|² / c²)``; then the share of surrounding patches that have a
    slope. Noise and grain have no mean slope. Errors of the light occur where the shading changes, and their
    borders, like those of materials, are few. A single material has isolated slopes, grey marble has them
    nearly everywhere.
    """
    soft = how.soft_texture
    light = np.maximum(shading.mean(axis=1), NO_SHADING)
    lit, quotient = np.log(light), np.log(np.maximum(image.mean(axis=1), 0) / light + DARK)

    def weighted(pixels: Pixels) -> tuple[np.ndarray, np.ndarray]:
        one, other = pixels
        chroma = colour_change(image[one], image[other]) / how.chroma_step**2
        even = np.exp(-np.abs(lit[other] - lit[one]) / how.shading_step - chroma)
        even *= trusted[one] & trusted[other]
        step = np.clip(quotient[other] - quotient[one], -soft.largest_change, soft.largest_change)
        return even * step, even

    change, weight = np.zeros((2, len(image))), np.zeros((2, len(image)))
    pairs = list(views.neighbours())
    for axis, ends, (step, even) in zip(cycle((0, 1)), pairs, on_threads(weighted, pairs), strict=False):
        for end in ends:
            add_at(change[axis], end, step)
            add_at(weight[axis], end, even)
    across, down = (
        patch_means(views, own) / (patch_means(views, every) + soft.shrinkage)
        for own, every in zip(change, weight, strict=True)
    )
    slope = rise(np.hypot(across, down) * views.side, soft.slopes)
    around_px = 2 * patch_side(views) - 1  # all patches that overlap this one's
    return rise(means_around(views, slope, around_px), soft.shares)
