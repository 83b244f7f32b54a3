"""How much a change of albedo costs, between neighbours and between views, by what the photos say of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.chromaticity import DARK, NO_SHADING, colour_change
from stages.photometry.stack import StackedViews

SOFTER = (
    0.3  # times the coarse λ, where paint changes softly: that is lost by more than the light's errors are
)
FIRM = 4.0  # times μ, how much more a link counts where views contradict each other
NOISE = 0.05  # of the logarithm: what the photo of textured surface may differ by without a reason
DOUBT = 0.1  # and that of other surface, where the light is the likelier reason


@dataclass(frozen=True)
class PaintEdges:
    """λ of Eq. 4, edge by edge.

    Attributes
    ----------
    coarse : float
        Where the shading changes and the colour does not: such an edge is likely to be the light's.
    fine : float
        Elsewhere: little, so that lines of a pixel's width stay.
    shading_step : float
        Change of log shading between neighbours that counts as one.
    chroma_step : float
        Likewise of the logarithms of red and blue over green.
    """

    coarse: float
    fine: float = 0.15
    shading_step: float = 0.02
    chroma_step: float = 0.12


def smoothness_of_edges(
    views: StackedViews,
    image: np.ndarray,
    shading: np.ndarray,
    textured: np.ndarray,
    soft: np.ndarray,
    edges: PaintEdges,
) -> np.ndarray:
    """λ of Eq. 4 for all edges in the order of `StackedViews.neighbours`, (E,), float32.

    Parameters
    ----------
    views : StackedViews
    image : ndarray, shape (N, 3)
        Scaled, in white light.
    shading : ndarray, shape (N, 3)
        As the light is known by now.
    textured : ndarray, shape (N,)
        0 to 1; see `Appearance`.
    soft : ndarray, shape (N,)
        0 to 1; see `soft_paint`.
    edges : PaintEdges

    Notes
    -----
    ``λ_pq = fine + (coarse − fine) · (1 − exp(−|Δ log S| / s)) · exp(−|Δ chroma|² / c²)``, s and c the steps.
    Light that is nearly neutral changes the brightness of paint, not its colour; and a model of the light
    errs where it changes: at creases, at the rims of shadows. Where the surface lies evenly in the light,
    whatever the photo shows is paint; and so it is where the photo changes by much more than the shading
    does: the exponent also takes ``(|Δ log I − Δ log S| / (|Δ log S| + d))²``, d = 0.1, or 0.05 where
    `textured`. A large λ takes away whatever is less than 2 λ px across, soft blotches as well as shadows
    that are not there: where paint is `soft`, coarse becomes ``max(0.3 coarse, fine)``.
    """
    brightness = np.log(np.maximum(shading.mean(axis=1), NO_SHADING)).astype(np.float32)
    seen = np.log(np.maximum(image.mean(axis=1), 0) + DARK).astype(np.float32)
    costs = []
    for one, other in views.neighbours():
        explained = np.abs(brightness[one] - brightness[other])
        lit = 1 - np.exp(-explained / edges.shading_step)
        coloured = colour_change(image[one], image[other]) / edges.chroma_step**2
        left = np.abs(seen[one] - seen[other] - brightness[one] + brightness[other])
        doubt = np.maximum(DOUBT - (DOUBT - NOISE) * (textured[one] + textured[other]) / 2, NOISE)
        paint = (left / (explained + doubt)) ** 2
        coarse = np.maximum(edges.coarse * SOFTER ** ((soft[one] + soft[other]) / 2), edges.fine)
        costs.append(edges.fine + (coarse - edges.fine) * lit * np.exp(-coloured - paint))
    return np.concatenate(costs).astype(np.float32)


def agreement_of_links(views: StackedViews, consistency: float, inconsistent: np.ndarray) -> np.ndarray:
    """μ of Eq. 5 for all links in the order of `StackedViews.linked_pixels`, (L,), float32.

    Where views contradict each other, (N,), 0 to 1, a pixel's own photo is the doubtful witness, and what the
    other views say counts more: ``μ (1 + 4 (d_p + d_q) / 2)``. Where they do not, links blur fine paint by
    their half a pixel, and gain nothing.
    """
    ends = [inconsistent[one] + inconsistent[other] for one, other in views.linked_pixels()]
    doubt = np.concatenate(ends) / 2 if ends else np.empty(0)
    return (consistency * (1 + FIRM * doubt)).astype(np.float32)
