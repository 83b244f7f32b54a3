"""What surface looks like to all views together: textured, inconsistent between them, or neither."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.albedo.paint_edges import PaintEdges
from stages.photometry.chromaticity import DARK, NO_SHADING, colour_change
from stages.photometry.neighbourhoods import add_at, patch_means
from stages.photometry.specular.highlights import Linked
from stages.photometry.specular.settings import LinkedPatchSettings
from stages.photometry.stack import StackedViews

DIM = 0.1  # of the median shading: quotients by less are noise
UNEXPLAINED = 0.06  # of the logarithm: a change that the shading leaves over, beyond as much as it explains
TEXTURED = (0.44, 0.56)  # share of the edges that are paint: from no texture to nothing else
INCONSISTENT = 0.05  # of the logarithm: views that disagree by more see gloss, or are wrong about the light


@dataclass(frozen=True, eq=False)
class Appearance:
    """Of every pixel's neighbourhood, 0 to 1, (N,), float32.

    Attributes
    ----------
    textured : ndarray
        Most changes are paint's, and the views agree about the surface.
    inconsistent : ndarray
        Few changes are, and the views contradict each other all the same.
    """

    textured: np.ndarray
    inconsistent: np.ndarray


def appearance_of(
    views: StackedViews,
    image: np.ndarray,
    shading: np.ndarray,
    trusted: np.ndarray,
    edges: PaintEdges,
    glossy: float,
) -> Appearance:
    """Tell surface by what the shading leaves over, and by what its views make of that.

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
    glossy : float
        How far there may be gloss of some paints, 0 to 1: they were found, or could not be looked for.

    Notes
    -----
    An edge is paint's where the photo changes by more than the shading explains,
    ``1 − exp(−(|Δ log I − Δ log S| / (|Δ log S| + 0.06))²)``, or in colour; the weight rises with the share
    of such edges in a neighbourhood. In surface of one paint there are few of them, whatever its relief: at
    the rims of shadows and at parts' borders, lines. So texture is told from errors of the light.
    Views are compared by the quotient I/S, where there is light enough, in small squares. They contradict
    each other where all around they differ one way, ``e = |mean excess|``; fine paint half a pixel off makes
    them differ both ways: ``inconsistent = (1 − g) (1 − exp(−(e / 0.05)²))``, g the share of paint. Glossy
    curls, whose highlights differ both ways, too, pass for paint; where there may be such, they are told from
    texture by how much views differ at all, ``d = mean |excess|``: ``textured = g exp(−(d / 0.05)²)``, and
    elsewhere ``g exp(−(e / 0.05)²)``; between the two by degrees.
    """
    brightness, light = (np.maximum(each.mean(axis=1), 0) for each in (image, shading))
    lit, seen = np.log(np.maximum(light, NO_SHADING)), np.log(brightness + DARK)
    paint, degree = np.zeros(len(image)), np.zeros(len(image))
    for one, other in views.neighbours():
        explained = lit[one] - lit[other]
        left = np.abs(seen[one] - seen[other] - explained) / (np.abs(explained) + UNEXPLAINED)
        coloured = colour_change(image[one], image[other]) / edges.chroma_step**2
        share = 1 - np.exp(-(left**2) - coloured)
        for end in (one, other):
            add_at(paint, end, share)
            add_at(degree, end, 1)
    grained = rise(patch_means(views, paint / np.maximum(degree, 1)), TEXTURED)
    sure = trusted & (light > DIM * np.median(light))
    quotient = np.log(brightness / np.maximum(light, NO_SHADING) + DARK)  # the same in any amount of light
    excess = Linked.of(views, sure, LinkedPatchSettings()).excess(quotient)
    agreed = _near(patch_means(views, excess))
    alike = agreed if glossy == 0 else _near(patch_means(views, np.abs(excess)))
    mixed = agreed + np.float32(glossy) * (alike - agreed)
    return Appearance(textured=grained * mixed, inconsistent=(1 - grained) * (1 - agreed))


def rise(share: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
    """0 below, 1 above two ends, smooth between; float32."""
    t = np.clip((share - ends[0]) / (ends[1] - ends[0]), 0, 1)
    return (t * t * (3 - 2 * t)).astype(np.float32)


def _near(difference: np.ndarray) -> np.ndarray:
    """1 where views agree, 0 where they differ by far more than `INCONSISTENT`."""
    return np.exp(-((difference / INCONSISTENT) ** 2)).astype(np.float32)
