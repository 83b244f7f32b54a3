"""Weights of albedo changes, λ between neighbours and μ between views, inferred from photos and shading."""

from __future__ import annotations

import numpy as np

from stages.photometry.albedo.settings import EdgeSettings
from stages.photometry.chromaticity import DARK, NO_SHADING, colour_change
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.pixelwise import on_threads
from stages.solvers.least_squares.difference_operators import Pixels


def smoothness_of_edges(
    views: StackedViews,
    image: np.ndarray,
    shading: np.ndarray,
    textured: np.ndarray,
    soft: np.ndarray,
    how: EdgeSettings,
) -> np.ndarray:
    """Compute λ of Eq. 4 for all edges in the order of `StackedViews.neighbours`, (E,), float32.

    Parameters
    ----------
    views : StackedViews
    image : ndarray, shape (N, 3)
        Scaled, in white light.
    shading : ndarray, shape (N, 3)
        Under the estimated light.
    textured : ndarray, shape (N,)
        0 to 1; see `Appearance`.
    soft : ndarray, shape (N,)
        0 to 1; see `soft_texture`.
    how : EdgeSettings

    Notes
    -----
    ``λ_pq = fine + (coarse − fine) · (1 − exp(−|Δ log S| / s)) · exp(−|Δ chroma|² / c² − θ²)``, s and c the
    steps, ``θ = |Δ log I − Δ log S| / (|Δ log S| + d)``, d the tolerance, smaller where `textured`.

    Nearly neutral light changes the brightness of a material, not its colour. A model of the light errs
    where the shading changes: at creases and at the borders of shadows. On evenly lit surface every change
    of the photo is albedo, and so is a change much larger than that of the shading. A large λ removes
    whatever is less than 2 λ px across, soft texture as well as errors of the light. Where the texture is
    `soft`, coarse becomes ``max(f coarse, fine)``, f its factor.
    """
    lit = np.log(np.maximum(shading.mean(axis=1), NO_SHADING)).astype(np.float32)
    seen = np.log(np.maximum(image.mean(axis=1), 0) + DARK).astype(np.float32)
    plain, least = how.residual_tolerance, how.textured_residual_tolerance
    most = how.coarse_at(views.side)

    def weight(pixels: Pixels) -> np.ndarray:
        one, other = pixels
        explained = np.abs(lit[one] - lit[other])
        changing = 1 - np.exp(-explained / how.shading_step)
        chroma = colour_change(image[one], image[other]) / how.chroma_step**2
        left = np.abs(seen[one] - seen[other] - lit[one] + lit[other])
        tolerance = np.maximum(plain - (plain - least) * (textured[one] + textured[other]) / 2, least)
        residual = (left / (explained + tolerance)) ** 2
        softness = (soft[one] + soft[other]) / 2
        coarse = np.maximum(most * how.soft_texture_factor**softness, how.fine_lambda)
        return how.fine_lambda + (coarse - how.fine_lambda) * changing * np.exp(-chroma - residual)

    return np.concatenate(on_threads(weight, views.neighbours())).astype(np.float32)


def agreement_of_correspondences(
    views: StackedViews, consistency: float, inconsistent: np.ndarray, gain: float
) -> np.ndarray:
    """Compute μ of Eq. 5 for all correspondences, ordered as `StackedViews.linked_pixels`, (L,), float32.

    Parameters
    ----------
    views : StackedViews
    consistency : float
        μ where views are consistent.
    inconsistent : ndarray, shape (N,)
        0 to 1; see `Appearance`.
    gain : float
        `EdgeSettings.inconsistency_gain`.

    Notes
    -----
    ``μ (1 + gain · (i_p + i_q) / 2)``. Where views are inconsistent, a pixel's own observation is the least
    reliable, and those of other views weigh more. Where they are consistent, a larger μ gains nothing and
    blurs fine texture, since correspondences are half a pixel off.
    """
    ends = [inconsistent[one] + inconsistent[other] for one, other in views.linked_pixels()]
    of_correspondences = np.concatenate(ends) / 2 if ends else np.empty(0)
    return (consistency * (1 + gain * of_correspondences)).astype(np.float32)
