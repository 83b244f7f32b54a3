"""Highlights, by what one view sees and the others do not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stages.photometry.neighbourhoods import means_around, patch_means
from stages.photometry.paint_edges import DARK
from stages.photometry.stack import Pixels, StackedViews

SIZE_PX = 5  # of the smallest highlight that is told from fine paint
FEWEST = 0.2  # share of a square that has to be linked for a word about it
ROUNDS = 3  # with each, the brighter of the views that are left come down to the rest
TOLERANCE = 0.02  # of the logarithm: noise
RARE = 0.05  # share of a patch: fewer negative values than that count for less


def without_highlights(views: StackedViews, image: np.ndarray, trusted: np.ndarray) -> np.ndarray:
    """Take off what a view sees of its surface beyond what the others see of it.

    Parameters
    ----------
    views : StackedViews
        Their links say what is the same surface.
    image : ndarray, shape (N, 3), float32
        Scaled, under one light; gains of the views divided out.
    trusted : ndarray, shape (N,), bool
        Pixels that others are compared with, and that are looked at: what is clipped is no measure.

    Returns
    -------
    ndarray, shape (N, 3), float32
        Nowhere above the image.

    Notes
    -----
    Matt surface looks the same from everywhere, and gloss only adds. Per channel, with ``l = log(I + d)``:
    ``l ← l − max(0, m − s − 0.02)``, m from `Linked.excess`, s the root mean square of what is negative
    among m around (less where hardly anything is). Views that see each other's fine paint half a pixel off
    differ in both directions alike, and keep what they have. Highlights of a few pixels are cut by half.
    """
    linked, matt = Linked.of(views, trusted), np.empty_like(image)
    for c, seen in enumerate(image.T):
        before = np.log(np.maximum(seen, 0) + DARK)
        after = before
        for _ in range(ROUNDS):
            excess = linked.excess(after)
            after = after - np.maximum(0, excess - _misfit(views, excess) - TOLERANCE)
        gloss = (np.maximum(seen, 0) + DARK) * (1 - np.exp(after - before))
        matt[:, c] = np.where(trusted, np.maximum(seen - gloss, np.minimum(seen, 0)), seen)
    return matt


def brightening(views: StackedViews, image: np.ndarray, trusted: np.ndarray) -> float:
    """How much further views rise above one another than they fall below.

    Parameters are those of `without_highlights`. Of the brightness' logarithm, root mean squares of
    `Linked.excess` where it is positive and where it is negative, one over the other; 1 where views see
    nothing of one another. Gloss only adds, and to few of the views of a place: the ratio is above 1.
    Light that moves casts shadows as well: below.
    """
    seen = np.log(np.maximum(image, 0).mean(axis=1) + DARK)
    excess = Linked.of(views, trusted).excess(seen)
    above, below = (np.sqrt(np.mean(np.maximum(side, 0) ** 2)) for side in (excess, -excess))
    return float(above / below) if below > 0 else 1.0


@dataclass(frozen=True, eq=False)
class Linked:
    """What pixels can be compared with, counted once.

    Attributes
    ----------
    views : StackedViews
    trusted : ndarray, shape (N,), bool
        Only links between such pixels count.
    links : ndarray, shape (N,)
        Mean number of links in a small square around every pixel.
    enough : ndarray, shape (N,), bool
        Whether a fifth of that square has some.
    """

    views: StackedViews
    trusted: np.ndarray
    links: np.ndarray
    enough: np.ndarray

    @classmethod
    def of(cls, views: StackedViews, trusted: np.ndarray) -> Linked:
        """Count the links of all pixels."""
        count = np.zeros(len(trusted))
        for ends in _trusted_links(views, trusted):
            for end in ends:
                np.add.at(count, end, 1)
        enough = means_around(views, count > 0, SIZE_PX) >= FEWEST
        return cls(views, trusted, means_around(views, count, SIZE_PX), enough)

    def excess(self, values: np.ndarray) -> np.ndarray:
        """Mean of ``v_p − v_q`` over all links of the pixels p in small squares to pixels q elsewhere, (N,).

        Fine paint, half a pixel off, comes to nothing there, a highlight does not. 0 where there are not
        `enough` links. The cost grows with the links.
        """
        total = np.zeros(len(values))
        for one, other in _trusted_links(self.views, self.trusted):
            difference = values[one] - values[other]
            np.add.at(total, one, difference)
            np.add.at(total, other, -difference)
        mean = means_around(self.views, total, SIZE_PX) / np.maximum(self.links, 1e-6)
        return np.where(self.enough, mean, 0)


def _trusted_links(views: StackedViews, trusted: np.ndarray) -> Iterator[Pixels]:
    for one, other in views.linked_pixels():
        both = trusted[one] & trusted[other]
        yield one[both], other[both]


def _misfit(views: StackedViews, excess: np.ndarray) -> np.ndarray:
    """Root mean square of the negative values around every pixel, (N,)."""
    square = patch_means(views, np.minimum(excess, 0) ** 2)
    share = patch_means(views, excess < 0)
    return np.sqrt(np.maximum(square, 0) / np.maximum(share, RARE))
