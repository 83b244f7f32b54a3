"""Classification of neighbourhoods: textured, inconsistent between views, or neither."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.albedo.settings import AppearanceSettings, EdgeSettings
from stages.photometry.chromaticity import DARK, NO_SHADING, colour_change
from stages.photometry.neighbourhoods import add_at, patch_means
from stages.photometry.specular.highlights import LinkedPatches
from stages.photometry.stack import StackedViews


@dataclass(frozen=True, eq=False)
class Appearance:
    """Degrees of every pixel's neighbourhood, 0 to 1, (N,), float32.

    Attributes
    ----------
    textured : ndarray
        Most edges are the albedo's, and the views agree about the surface.
    inconsistent : ndarray
        Few edges are, and the views contradict each other all the same.
    """

    textured: np.ndarray
    inconsistent: np.ndarray


def appearance_of(
    views: StackedViews,
    image: np.ndarray,
    shading: np.ndarray,
    trusted: np.ndarray,
    how: EdgeSettings,
    glossy: float,
) -> Appearance:
    """Classify neighbourhoods by what the shading leaves unexplained, and by how views differ in that.

    Parameters
    ----------
    views : StackedViews
    image : ndarray, shape (N, 3)
        Scaled, in white light; highlights and all.
    shading : ndarray, shape (N, 3)
    trusted : ndarray, shape (N,), bool
        Pixels by which views are compared.
    how : EdgeSettings
        The step of chroma, and `appearance`.
    glossy : float
        How far some materials may be glossy, 0 to 1: they were found, or could not be looked for.

    Notes
    -----
    An edge is the albedo's where the photo changes by more than the shading explains, or in colour:
    ``1 − exp(−(|Δ log I − Δ log S| / (|Δ log S| + d))² − |Δ chroma|² / c²)``, d the tolerance. `textured`
    rises with the share g of such edges in a neighbourhood. On a single material there are few of them,
    whatever its relief; at the rims of shadows and at parts' borders they are lines. So texture is
    distinguished from errors of the light.

    Views are compared by the quotient I/S, where there is light enough, in small squares. They contradict
    each other where all around they differ one way, ``e = |mean excess|``; fine texture half a pixel off
    makes them differ both ways: ``inconsistent = (1 − g) (1 − exp(−(e / v)²))``, v their difference. Glossy
    curls, whose highlights differ both ways, too, pass for texture; where there may be such, they are
    distinguished by how much views differ at all, ``d = mean |excess|``: ``textured = g exp(−(d / v)²)``, and
    elsewhere ``g exp(−(e / v)²)``; between the two by degrees.
    """
    own = how.appearance
    brightness, light = (np.maximum(each.mean(axis=1), 0) for each in (image, shading))
    lit, seen = np.log(np.maximum(light, NO_SHADING)), np.log(brightness + DARK)
    of_albedo, degree = np.zeros(len(image)), np.zeros(len(image))
    for one, other in views.neighbours():
        explained = lit[one] - lit[other]
        residual = np.abs(seen[one] - seen[other] - explained) / (np.abs(explained) + own.residual_tolerance)
        chroma = colour_change(image[one], image[other]) / how.chroma_step**2
        likely = 1 - np.exp(-(residual**2) - chroma)
        for end in (one, other):
            add_at(of_albedo, end, likely)
            add_at(degree, end, 1)
    grained = rise(patch_means(views, of_albedo / np.maximum(degree, 1)), own.textured_share)
    compared = trusted & (light > own.least_shading * np.median(light))
    quotient = np.log(brightness / np.maximum(light, NO_SHADING) + DARK)  # the same in any amount of light
    excess = LinkedPatches.of(views, compared, own.patches).excess(quotient)
    agreed = _agreement(patch_means(views, excess), own)
    alike = agreed if glossy == 0 else _agreement(patch_means(views, np.abs(excess)), own)
    mixed = agreed + np.float32(glossy) * (alike - agreed)
    return Appearance(textured=grained * mixed, inconsistent=(1 - grained) * (1 - agreed))


def rise(share: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
    """Rise smoothly from 0 at the lower end, and below, to 1 at the upper, and above; float32."""
    t = np.clip((share - ends[0]) / (ends[1] - ends[0]), 0, 1)
    return (t * t * (3 - 2 * t)).astype(np.float32)


def _agreement(difference: np.ndarray, how: AppearanceSettings) -> np.ndarray:
    """Weigh differences between views: 1 where they agree, 0 where they differ by far more than they may."""
    return np.exp(-((difference / how.view_difference) ** 2)).astype(np.float32)
