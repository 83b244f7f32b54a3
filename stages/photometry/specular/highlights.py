"""Detection and removal of highlights and dark outliers by comparison of views."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from stages.photometry.neighbourhoods import add_at, means_around, patch_means
from stages.photometry.specular.settings import DarkOutlierSettings, HighlightSettings, LinkedPatchSettings
from stages.photometry.stack import Pixels, StackedViews
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
        excess = np.stack([linked.excess(channel) for channel in after.T], axis=1)
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
    for one, other in trusted_correspondences(linked.views, linked.trusted):
        difference = seen[other] - seen[one]
        add_at(balance, one, np.where(difference > darker, 1, -1))
        add_at(balance, other, np.where(-difference > darker, 1, -1))
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
        for ends in trusted_correspondences(views, trusted):
            for end in ends:
                add_at(count, end, 1)
        enough = means_around(views, count > 0, patches.patch_px) >= patches.min_linked_share
        return cls(views, trusted, patches, means_around(views, count, patches.patch_px), enough)

    def excess(self, values: np.ndarray) -> np.ndarray:
        """Average ``v_p − v_q`` over the correspondences (p, q) of the pixels p in small squares, (N,).

        Misregistration of fine texture by half a pixel averages out, a highlight does not. 0 where there are
        not `enough` correspondences. The cost is linear in their number.
        """
        total = np.zeros(len(values))
        for one, other in trusted_correspondences(self.views, self.trusted):
            difference = values[one] - values[other]
            add_at(total, one, difference)
            add_at(total, other, -difference)
        mean = means_around(self.views, total, self.patches.patch_px) / np.maximum(self.correspondences, 1e-6)
        return np.where(self.enough, mean, 0)

    def log_brightness(self, image: np.ndarray) -> np.ndarray:
        """Compute the log of the channels' mean, (N,), with a floor below which values hardly differ."""
        return np.log(np.maximum(image, 0).mean(axis=1) + self.patches.log_floor)


def trusted_correspondences(views: StackedViews, trusted: np.ndarray) -> Iterator[Pixels]:
    """Yield corresponding pixels, pair of views by pair, that are both trusted, (N,) bool."""
    for one, other in views.linked_pixels():
        both = trusted[one] & trusted[other]
        yield one[both], other[both]


def _misfit(views: StackedViews, excess: np.ndarray, min_negative_share: float) -> np.ndarray:
    """Compute the root mean square of negative values around every pixel, (N,); less where they are rare."""
    square = patch_means(views, np.minimum(excess, 0) ** 2)
    share = patch_means(views, excess < 0)
    return np.sqrt(np.maximum(square, 0) / np.maximum(share, min_negative_share))
