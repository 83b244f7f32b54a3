"""Where surface is textured, the photo divided by its shading; elsewhere the smooth albedo."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from stages.photometry.paint_edges import DARK, PaintEdges, colour_change
from stages.photometry.stack import StackedViews

PATCHES = 15  # along the side of a view: what is textured is a matter of neighbourhoods
UNEXPLAINED = 0.06  # of the logarithm: a change that the shading leaves over, beyond as much as it explains
TEXTURED = (0.44, 0.56)  # share of the edges that are paint: from nothing of the detail to all of it
HIGHLIGHT_PX = 5  # smallest highlight that is told from fine paint
GLOSS = 0.05  # of the logarithm: views that disagree by more see gloss
DIM = 0.1  # of the median shading: quotients by less are noise
NOISE = 0.04  # of the logarithm: detail well below is noise, and goes


def texture_of(views: StackedViews, image: np.ndarray, shading: np.ndarray, edges: PaintEdges) -> np.ndarray:
    """How textured the surface around every pixel is, 0 to 1, by what the shading leaves over.

    Parameters
    ----------
    views : StackedViews
    image, shading : ndarray, shape (N, 3)
        Scaled.
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
    rise = np.clip((_patch_means(views, paint / np.maximum(degree, 1)) - low) / (high - low), 0, 1)
    matt = np.exp(-((_gloss(views, seen - lit) / GLOSS) ** 2))
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


def _gloss(views: StackedViews, quotient: np.ndarray) -> np.ndarray:
    """How much views disagree about the log quotient I/S around every pixel, (N,).

    Signed differences are averaged in small squares first: fine paint, half a pixel off, comes to nothing
    there, a highlight does not.
    """
    excess, links = np.zeros(len(quotient)), np.zeros(len(quotient))
    for one, other in views.linked_pixels():
        difference = quotient[one] - quotient[other]
        for end, signed in ((one, difference), (other, -difference)):
            np.add.at(excess, end, signed)
            np.add.at(links, end, 1)
    return _patch_means(views, np.abs(_means(views, excess / np.maximum(links, 1), HIGHLIGHT_PX)))


def _patch_means(views: StackedViews, values: np.ndarray) -> np.ndarray:
    return _means(views, values, max(3, 2 * round(views.side / PATCHES / 2) + 1))


def _means(views: StackedViews, values: np.ndarray, size: int) -> np.ndarray:
    """Mean of the values in a square around every pixel, inside its mask, (N,)."""
    return np.concatenate(list(_means_of_views(views, values, size)))


def _means_of_views(views: StackedViews, values: np.ndarray, size: int) -> Iterator[np.ndarray]:
    for number, mask in enumerate(views.masks):
        image = np.zeros(mask.shape, np.float32)
        image[mask] = values[views.view(number)]
        total, full = (
            cv2.boxFilter(one, -1, (size, size), normalize=False) for one in (image, mask.astype(np.float32))
        )
        yield (total / np.maximum(full, 1))[mask]
