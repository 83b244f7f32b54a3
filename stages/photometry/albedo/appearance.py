"""Classification of neighbourhoods: textured, inconsistent between views, or neither."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.albedo.settings import AppearanceSettings, EdgeSettings
from stages.photometry.albedo_data import typical_light_of
from stages.photometry.chromaticity import DARK, NO_SHADING, colour_change
from stages.photometry.neighbourhoods import add_at, patch_means
from stages.photometry.specular.highlights import LinkedPatches
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.pixelwise import on_threads
from stages.solvers.least_squares.difference_operators import Pixels


@dataclass(frozen=True, eq=False)
class Appearance:
    """Degrees of every pixel's neighbourhood, 0 to 1, (N,), float32.

    Attributes
    ----------
    textured : ndarray
        Most edges are edges of the albedo, and the views are consistent.
    inconsistent : ndarray
        Few edges are, yet the views are inconsistent.
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
    typical_light: float | None = None,
) -> Appearance:
    """Classify neighbourhoods by the residual of the shading and its differences between views.

    Parameters
    ----------
    views : StackedViews
    image : ndarray, shape (N, 3)
        Scaled, in white light, highlights included.
    shading : ndarray, shape (N, 3)
    trusted : ndarray, shape (N,), bool
        Pixels in which views are compared.
    how : EdgeSettings
        `chroma_step` and `appearance` are used.
    glossy : float
        Degree to which materials may be glossy, 0 to 1: they were detected, or could not be.
    typical_light : float or None
        See `typical_light_of`; None: that of these pixels.

    Notes
    -----
    An edge is one of albedo where the photo changes by more than the shading, or in colour:
    ``1 − exp(−(|Δ log I − Δ log S| / (|Δ log S| + d))² − |Δ chroma|² / c²)``, d the tolerance. `textured`
    rises with the share g of such edges in a neighbourhood. A single material has few of them, whatever its
    relief; at the borders of shadows and parts they are lines. This distinguishes texture from errors of the
    light.

    Views are compared by the quotient I/S, in small squares, where the shading is sufficient. Inconsistent
    views differ with one sign throughout a neighbourhood, ``e = |mean excess|``; fine texture half a pixel
    off gives both signs: ``inconsistent = (1 − g) (1 − exp(−(e / v)²))``, v the setting `view_difference`.
    Highlights on fine glossy relief give both signs, too, and resemble texture. Where materials may be
    glossy, they are distinguished by the magnitude of the differences, ``d = mean |excess|``:
    ``textured = g exp(−(d / v)²)``, otherwise ``g exp(−(e / v)²)``, mixed by `glossy`.
    """
    own = how.appearance
    brightness, light = (np.maximum(each.mean(axis=1), 0) for each in (image, shading))
    lit, seen = np.log(np.maximum(light, NO_SHADING)), np.log(brightness + DARK)

    def likely(pixels: Pixels) -> np.ndarray:
        one, other = pixels
        explained = lit[one] - lit[other]
        residual = np.abs(seen[one] - seen[other] - explained) / (np.abs(explained) + own.residual_tolerance)
        chroma = colour_change(image[one], image[other]) / how.chroma_step**2
        return 1 - np.exp(-(residual**2) - chroma)

    of_albedo, degree = np.zeros(len(image)), np.zeros(len(image))
    pairs = list(views.neighbours())
    for ends, share in zip(pairs, on_threads(likely, pairs), strict=True):
        for end in ends:
            add_at(of_albedo, end, share)
            add_at(degree, end, 1)
    grained = rise(patch_means(views, of_albedo / np.maximum(degree, 1)), own.textured_share)
    typical = typical_light_of(shading) if typical_light is None else typical_light
    compared = trusted & (light > own.least_shading * typical)
    quotient = np.log(brightness / np.maximum(light, NO_SHADING) + DARK)  # invariant to the amount of light
    excess = LinkedPatches.of(views, compared, own.patches).excess(quotient)
    agreed = _agreement(patch_means(views, excess), own)
    alike = agreed if glossy == 0 else _agreement(patch_means(views, np.abs(excess)), own)
    mixed = agreed + np.float32(glossy) * (alike - agreed)
    return Appearance(textured=grained * mixed, inconsistent=(1 - grained) * (1 - agreed))


def rise(share: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
    """Evaluate a smoothstep: 0 up to the lower end, 1 from the upper end on; float32."""
    t = np.clip((share - ends[0]) / (ends[1] - ends[0]), 0, 1)
    return (t * t * (3 - 2 * t)).astype(np.float32)


def _agreement(difference: np.ndarray, how: AppearanceSettings) -> np.ndarray:
    """Weight differences between views by ``exp(−(difference / v)²)``, float32."""
    return np.exp(-((difference / how.view_difference) ** 2)).astype(np.float32)
