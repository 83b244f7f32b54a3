"""Highlights, by what one view sees and the others do not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stages.photometry.neighbourhoods import add_at, means_around, patch_means
from stages.photometry.specular.settings import DarkOutlierSettings, HighlightSettings, LinkedPatchSettings
from stages.photometry.stack import Pixels, StackedViews


def without_highlights(linked: LinkedPatches, image: np.ndarray, how: HighlightSettings) -> np.ndarray:
    """Take off what a view sees of its surface beyond what the others see of it.

    Parameters
    ----------
    linked : LinkedPatches
        What is the same surface. Only trusted pixels are compared, and looked at: what is clipped is no
        measure.
    image : ndarray, shape (N, 3), float32
        Scaled, under one light; gains of the views divided out.
    how : HighlightSettings

    Returns
    -------
    ndarray, shape (N, 3), float32
        Nowhere above the image.

    Notes
    -----
    Diffuse surface looks the same from everywhere, and specular reflection only adds. With ``l = log(I + d)``
    and m its `LinkedPatches.excess`, per channel: ``l ← l − t max(0, m)``, where
    ``t = Σ max(0, m − s − ε) / Σ max(0, m)`` over the channels, ε
    `tolerance`, s the root mean square of what is negative among m around (less where hardly anything is).
    One t for all channels, so that the colour moves straight to that which the others see: a window that
    shows the sky does not turn green. Views that see each other's fine paint half a pixel off differ in both
    directions alike, and keep what they have. Highlights of a few pixels are cut by half.
    """
    seen = np.maximum(image, 0)
    floor = linked.patches.log_floor
    before = np.log(seen + floor)
    after = before
    for _ in range(how.rounds):
        excess = np.stack([linked.excess(channel) for channel in after.T], axis=1)
        misfit = np.stack(
            [_misfit(linked.views, channel, how.min_negative_share) for channel in excess.T], axis=1
        )
        above = np.maximum(excess, 0)
        beyond = np.maximum(excess - misfit - how.tolerance, 0).sum(axis=1, keepdims=True)
        share = beyond / np.maximum(above.sum(axis=1, keepdims=True), 1e-9)
        after = (after - share * above).astype(np.float32)
    gloss = (seen + floor) * (1 - np.exp(after - before))
    diffuse = np.maximum(image - gloss, np.minimum(image, 0))
    return np.where(linked.trusted[:, None], diffuse, image).astype(np.float32)


def brightening(linked: LinkedPatches, image: np.ndarray) -> float:
    """How much further views rise above one another than they fall below.

    Parameters
    ----------
    linked : LinkedPatches
        What is the same surface.
    image : ndarray, shape (N, 3)
        Scaled; gains of the views divided out.

    Returns
    -------
    float
        Of `LinkedPatches.excess` of the brightness' logarithm, over trusted pixels: root mean square of what
        is positive over that of what is negative. 1 where views see nothing of one another.

    Notes
    -----
    A highlight that one of n views sees of a place makes it about √(n − 1): above 1 for gloss, though two
    views hardly tell. Lamps that are carried about light most places in most views and leave deep
    shadows: below 1. Light that is brighter in few of many views passes for gloss.
    """
    seen = linked.log_brightness(image)
    excess = linked.excess(seen)[linked.trusted]
    above, below = (np.square(np.maximum(side, 0)).sum() for side in (excess, -excess))
    return float(np.sqrt(above / below)) if below > 0 else 1.0


def darker_outliers(
    linked: LinkedPatches, image: np.ndarray, how: DarkOutlierSettings, power: float = 1.0
) -> np.ndarray:
    """Pixels that most other views contradict: they see the same surface, and far brighter.

    Parameters
    ----------
    linked : LinkedPatches
        What is the same surface.
    image : ndarray, shape (N, 3)
        Scaled, under one light; gains of the views divided out.
    how : DarkOutlierSettings
    power : float
        Of its `ratio`, by which the others must see it brighter.

    Returns
    -------
    ndarray, shape (N,), bool

    Notes
    -----
    One walks through the picture, the photographer's shadow falls on the stone, a background was painted
    black: to the views that see the place as it is, it would be a highlight of theirs. Over most of its links
    a pixel sees less than a third (1 over that ratio), and it is black, or most links of the square around
    it, or of one close by, say so too; gloss hardly ever does as much (see docs/experiments.md). A square is
    asked where pixels have more links than one: of two views alone, either may be the one that is wrong. What
    is dark wherever it is seen stays.
    """
    seen, darker = linked.log_brightness(image), np.log(how.ratio**power)
    size_px = linked.patches.patch_px
    balance = np.zeros(len(seen), np.int32)
    for one, other in trusted_correspondences(linked.views, linked.trusted):
        difference = seen[other] - seen[one]
        add_at(balance, one, np.where(difference > darker, 1, -1))
        add_at(balance, other, np.where(-difference > darker, 1, -1))
    asked = linked.enough & (linked.correspondences > how.min_correspondences_per_pixel)
    place = asked & (means_around(linked.views, balance, size_px) > 0)
    close = means_around(linked.views, place, size_px) > 0
    return place | (balance > 0) & (close | (image.max(axis=1) <= how.black))


@dataclass(frozen=True, eq=False)
class LinkedPatches:
    """What pixels can be compared with, counted once.

    Attributes
    ----------
    views : StackedViews
    trusted : ndarray, shape (N,), bool
        Only links between such pixels count.
    patches : LinkedPatchSettings
    links : ndarray, shape (N,)
        Mean number of links in a small square around every pixel.
    enough : ndarray, shape (N,), bool
        Whether enough of that square has some.
    """

    views: StackedViews
    trusted: np.ndarray
    patches: LinkedPatchSettings
    correspondences: np.ndarray
    enough: np.ndarray

    @classmethod
    def of(cls, views: StackedViews, trusted: np.ndarray, patches: LinkedPatchSettings) -> LinkedPatches:
        """Count the links of all pixels."""
        count = np.zeros(len(trusted))
        for ends in trusted_correspondences(views, trusted):
            for end in ends:
                add_at(count, end, 1)
        enough = means_around(views, count > 0, patches.patch_px) >= patches.min_linked_share
        return cls(views, trusted, patches, means_around(views, count, patches.patch_px), enough)

    def excess(self, values: np.ndarray) -> np.ndarray:
        """Mean of ``v_p − v_q`` over all links of the pixels p in small squares to pixels q elsewhere, (N,).

        Fine paint, half a pixel off, comes to nothing there, a highlight does not. 0 where there are not
        `enough` links. The cost grows with the links.
        """
        total = np.zeros(len(values))
        for one, other in trusted_correspondences(self.views, self.trusted):
            difference = values[one] - values[other]
            add_at(total, one, difference)
            add_at(total, other, -difference)
        mean = means_around(self.views, total, self.patches.patch_px) / np.maximum(self.correspondences, 1e-6)
        return np.where(self.enough, mean, 0)

    def log_brightness(self, image: np.ndarray) -> np.ndarray:
        """Of the channels' mean, (N,); what is darker than noise hardly differs."""
        return np.log(np.maximum(image, 0).mean(axis=1) + self.patches.log_floor)


def trusted_correspondences(views: StackedViews, trusted: np.ndarray) -> Iterator[Pixels]:
    """Pairs of pixels that show the same surface point and are both trusted, (N,) bool."""
    for one, other in views.linked_pixels():
        both = trusted[one] & trusted[other]
        yield one[both], other[both]


def _misfit(views: StackedViews, excess: np.ndarray, min_negative_share: float) -> np.ndarray:
    """Root mean square of the negative values around every pixel, (N,); less where they are rare."""
    square = patch_means(views, np.minimum(excess, 0) ** 2)
    share = patch_means(views, excess < 0)
    return np.sqrt(np.maximum(square, 0) / np.maximum(share, min_negative_share))
