"""Where surface is textured, the photo divided by its shading; elsewhere the smooth albedo."""

from __future__ import annotations

import numpy as np

from stages.photometry.highlights import Linked
from stages.photometry.neighbourhoods import patch_means
from stages.photometry.paint_edges import DARK, PaintEdges, colour_change
from stages.photometry.stack import StackedViews

UNEXPLAINED = 0.06  # of the logarithm: a change that the shading leaves over, beyond as much as it explains
TEXTURED = (0.44, 0.56)  # share of the edges that are paint: from nothing of the detail to all of it
GLOSS = 0.05  # of the logarithm: views that disagree by more see gloss
DIM = 0.1  # of the median shading: quotients by less are noise
NOISE = 0.04  # of the logarithm: detail well below is noise, and goes


def texture_of(
    views: StackedViews, image: np.ndarray, shading: np.ndarray, trusted: np.ndarray, edges: PaintEdges
) -> np.ndarray:
    """How textured the surface around every pixel is, 0 to 1, by what the shading leaves over.

    Parameters
    ----------
    views : StackedViews
    image : ndarray, shape (N, 3)
        Scaled, in white light; highlights and all.
    shading : ndarray, shape (N, 3)
    trusted : ndarray, shape (N,), bool
        Pixels by which views are compared.
    edges : PaintEdges
        Its step of chroma.

    Returns
    -------
    ndarray, shape (N,), float32

    Notes
    -----
    An edge is paint's where the photo changes by more than the shading explains,
    ``1 − exp(−(|Δ log I − Δ log S| / (|Δ log S| + 0.06))²)``, or in colour; the weight rises with the share
    of such edges in a neighbourhood. In surface of one paint there are few of them, whatever its relief: at
    the rims of shadows and at parts' borders, lines. So texture is told from errors of the light.
    Highlights are told from it by the views: they disagree about them.
    """
    lit = np.log(np.maximum(shading.mean(axis=1), 1e-3))
    seen = np.log(np.maximum(image.mean(axis=1), 0) + DARK)
    paint, degree = np.zeros(len(image)), np.zeros(len(image))
    for one, other in views.neighbours():
        explained = lit[one] - lit[other]
        left = np.abs(seen[one] - seen[other] - explained) / (np.abs(explained) + UNEXPLAINED)
        coloured = colour_change(image[one], image[other]) / edges.chroma_step**2
        share = 1 - np.exp(-(left**2) - coloured)
        for end in (one, other):
            np.add.at(paint, end, share)
            np.add.at(degree, end, 1)
    low, high = TEXTURED
    rise = np.clip((patch_means(views, paint / np.maximum(degree, 1)) - low) / (high - low), 0, 1)
    matt = np.exp(-((_gloss(views, seen - lit, trusted) / GLOSS) ** 2))
    return (matt * rise * rise * (3 - 2 * rise)).astype(np.float32)


def with_detail(
    albedo: np.ndarray, image: np.ndarray, shading: np.ndarray, trusted: np.ndarray, textured: np.ndarray
) -> np.ndarray:
    """Give the albedo, (N, 3), the detail back that the smoothness took, where the surface is textured.

    Notes
    -----
    ``ρ · exp(w r max(0, 1 − (0.04/r)²))`` with ``r = log(I / (ρ S))``: the photo divided by its shading where
    w is 1, but for what is as small as noise. Only where there is light enough, and data.
    """
    enough = trusted & (shading.mean(axis=1) > DIM * np.median(shading))
    quotient = np.maximum(image, 1e-4) / np.maximum(np.maximum(albedo, 1e-4) * shading, 1e-6)
    left = np.clip(np.log(quotient), -1, 1)
    firm = left * np.maximum(0, 1 - NOISE**2 / np.maximum(left**2, 1e-12))
    share = np.where(enough, textured, 0)[:, None]
    return (np.maximum(albedo, 0) * np.exp(share * firm)).astype(np.float32)


def _gloss(views: StackedViews, quotient: np.ndarray, trusted: np.ndarray) -> np.ndarray:
    """How much views disagree about the log quotient I/S around every pixel, (N,)."""
    return patch_means(views, np.abs(Linked.of(views, trusted).excess(quotient)))
