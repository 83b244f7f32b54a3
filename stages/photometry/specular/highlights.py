"""Detection and removal of highlights and dark outliers by comparison of views."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from stages.photometry.neighbourhoods import means_around, patch_means
from stages.photometry.specular.linked_kernels import add_differences, count_linked, vote_dark
from stages.photometry.specular.settings import DarkOutlierSettings, HighlightSettings, LinkedPatchSettings
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.pixelwise import pixelwise


def without_highlights(linked: LinkedPatches, image: np.ndarray, how: HighlightSettings) -> np.ndarray:
    """Remove radiance of a view in excess of the other views at the same surface.

    Parameters
    ----------
    linked : LinkedPatches
        Correspondences. Only trusted pixels are compared and changed: clipped ones are no measure.
    image : ndarray, shape (N, 3), float32
        Scaled, under one light; gains of the views divided out.
    how : HighlightSettings

    Returns
    -------
    ndarray, shape (N, 3), float32
        Nowhere above the image.

    Notes
    -----
    Diffuse radiance is equal in all views, and specular reflection only adds. With ``l = log(I + d)`` and m
    its `LinkedPatches.excess`, per channel: ``l ← l − t max(0, m)``, where
    ``t = Σ max(0, m − s − ε) / Σ max(0, m)`` over the channels, ε
    `tolerance`, s the root mean square of negative m in the neighbourhood (less where they are rare).
    One t for all channels moves the colour straight to that of the other views: a window that mirrors the sky
    does not become green. Fine texture misregistered by half a pixel differs equally in both directions, and
    is kept. Highlights of a few pixels are halved.
    """
    floor = linked.patches.log_floor
    after = pixelwise(partial(_log_of, floor), image)
    for _ in range(how.rounds):
        excess = linked.excess(after)
        misfit = np.stack(
            [_misfit(linked.views, channel, how.min_negative_share) for channel in excess.T], axis=1
        )
        after = pixelwise(partial(_lowered, how.tolerance), after, excess, misfit)
    return pixelwise(partial(_without_gloss, floor), image, after, linked.trusted)


def _log_of(floor: float, image: np.ndarray) -> np.ndarray:
    return np.log(np.maximum(image, 0) + floor)


def _lowered(tolerance: float, logs: np.ndarray, excess: np.ndarray, misfit: np.ndarray) -> np.ndarray:
    """Lower logarithms by their excess beyond the misfit, in all channels by the same share of it."""
    above = np.maximum(excess, 0)
    beyond = np.maximum(excess - misfit - tolerance, 0).sum(axis=1, keepdims=True)
    share = beyond / np.maximum(above.sum(axis=1, keepdims=True), 1e-9)
    return (logs - share * above).astype(np.float32)


def _without_gloss(floor: float, image: np.ndarray, logs: np.ndarray, trusted: np.ndarray) -> np.ndarray:
    """Darken trusted pixels to their lowered logarithms; nothing below 0 but what was."""
    seen = np.maximum(image, 0)
    gloss = (seen + floor) * (1 - np.exp(logs - np.log(seen + floor)))
    diffuse = np.maximum(image - gloss, np.minimum(image, 0))
    return np.where(trusted[:, None], diffuse, image).astype(np.float32)


def brightening(linked: LinkedPatches, image: np.ndarray) -> float:
    """Compute the ratio of positive to negative differences between views.

    Parameters
    ----------
    linked : LinkedPatches
        Correspondences.
    image : ndarray, shape (N, 3)
        Scaled; gains of the views divided out.

    Returns
    -------
    float
        Of `LinkedPatches.excess` of log brightness over trusted pixels: root mean square of the positive
        values over that of the negative ones. 1 without correspondences.

    Notes
    -----
    A highlight in one of n views gives about √(n − 1): above 1 for gloss, though two views hardly distinguish
    it. Moved lamps light most places in most views and cast deep shadows in few: below 1. Light that is
    brighter in few of many views cannot be distinguished from gloss.
    """
    seen = linked.log_brightness(image)
    excess = linked.excess(seen)[linked.trusted]
    above, below = (np.square(np.maximum(side, 0)).sum() for side in (excess, -excess))
    return float(np.sqrt(above / below)) if below > 0 else 1.0


def darker_outliers(
    linked: LinkedPatches, image: np.ndarray, how: DarkOutlierSettings, power: float = 1.0
) -> np.ndarray:
    """Detect pixels that are far darker than their correspondences in most other views.

    Parameters
    ----------
    linked : LinkedPatches
        Correspondences.
    image : ndarray, shape (N, 3)
        Scaled, under one light; gains of the views divided out.
    how : DarkOutlierSettings
    power : float
        Exponent of `ratio`, by which the other views must be brighter.

    Returns
    -------
    ndarray, shape (N,), bool

    Notes
    -----
    Passers-by, the photographer's shadow or a background painted black would make the other views of the
    place seem to have highlights. Over most of its correspondences an outlier has less than a third of their
    brightness (1 over that ratio). It is also black, or most correspondences of the square around it, or of
    one close by, agree; gloss hardly ever differs as much (see docs/experiments.md). A square is used where
    pixels have more than one correspondence: of two views alone, either may be wrong. Surface that is dark in
    all views is kept.
    """
    seen, darker = linked.log_brightness(image), np.log(how.ratio**power)
    size_px = linked.patches.patch_px
    balance = np.zeros(len(seen), np.int32)
    for pair in linked.views.linked_rows():
        vote_dark(*pair, linked.trusted, seen, darker, balance)
    used = linked.enough & (linked.correspondences > how.min_correspondences_per_pixel)
    place = used & (means_around(linked.views, balance, size_px) > 0)
    close = means_around(linked.views, place, size_px) > 0
    return place | (balance > 0) & (close | (image.max(axis=1) <= how.black))


@dataclass(frozen=True, eq=False)
class LinkedPatches:
    """Correspondences between trusted pixels, counted over small squares.

    Attributes
    ----------
    views : StackedViews
    trusted : ndarray, shape (N,), bool
        Only correspondences between such pixels count.
    patches : LinkedPatchSettings
    correspondences : ndarray, shape (N,)
        Mean number of correspondences in a small square around every pixel.
    enough : ndarray, shape (N,), bool
        Whether a sufficient share of that square has correspondences.
    """

    views: StackedViews
    trusted: np.ndarray
    patches: LinkedPatchSettings
    correspondences: np.ndarray
    enough: np.ndarray

    @classmethod
    def of(cls, views: StackedViews, trusted: np.ndarray, patches: LinkedPatchSettings) -> LinkedPatches:
        """Count the correspondences of all pixels."""
        count = np.zeros(len(trusted))
        for pair in views.linked_rows():
            count_linked(*pair, trusted, count)
        enough = means_around(views, count > 0, patches.patch_px) >= patches.min_linked_share
        return cls(views, trusted, patches, means_around(views, count, patches.patch_px), enough)

    def excess(self, values: np.ndarray) -> np.ndarray:
        """Average ``v_p − v_q`` over the correspondences (p, q) of the pixels p in small squares, as values.

        Values are (N,) or (N, channels). Misregistration of fine texture by half a pixel averages out, a
        highlight does not. 0 where there are not `enough` correspondences. The cost is linear in theirs.
        """
        channels = np.ascontiguousarray(values).reshape(len(values), -1)
        total = np.zeros(channels.shape, np.float32)
        for pair in self.views.linked_rows():
            add_differences(*pair, self.trusted, channels, total)
        of_square = np.maximum(self.correspondences, np.float32(1e-6))
        for channel in range(total.shape[1]):  # in place of the totals: of many pixels, each array counts
            mean = means_around(self.views, total[:, channel], self.patches.patch_px) / of_square
            total[:, channel] = np.where(self.enough, mean, 0)
        return total.reshape(values.shape)

    def log_brightness(self, image: np.ndarray) -> np.ndarray:
        """Compute the log of the channels' mean, (N,), with a floor below which values hardly differ."""
        return np.log(np.maximum(image, 0).mean(axis=1) + self.patches.log_floor)


def _misfit(views: StackedViews, excess: np.ndarray, min_negative_share: float) -> np.ndarray:
    """Compute the root mean square of negative values around every pixel, (N,); less where they are rare."""
    square = patch_means(views, np.minimum(excess, 0) ** 2)
    share = patch_means(views, excess < 0)
    return np.sqrt(np.maximum(square, 0) / np.maximum(share, min_negative_share))
