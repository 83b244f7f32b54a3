"""Pairs of pixels that are likely to show the same paint: near one another, or of the same chromaticity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.paint_edges import chroma_of
from stages.photometry.stack import StackedViews

# Of the logarithms of red and blue over green: colours in one cell of this size pass for one. Pairs are drawn
# for the light; `decomposition.chroma_step` says what passes for an edge of paint once the light is known.
COLOUR_CELL = 0.12
PARTNERS = 4  # of either kind, per pixel
NEAR = 0.1  # of a view's side: pixels that are likely to be of one paint


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pixels of a sample, two by two, and how much every pair counts; all weights sum to 1."""

    first: np.ndarray
    second: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True, eq=False)
class Drawn:
    """Some of the pixels of all views, n, and where they are.

    Attributes
    ----------
    pixels : ndarray, shape (n,)
        Their places in the stack, sorted.
    views : ndarray, shape (n,)
        Number of the view that each belongs to.
    positions : ndarray, shape (n, 2)
        Row and column there.
    radius : int
        Side of the squares in which pixels are near, px.
    """

    pixels: np.ndarray
    views: np.ndarray
    positions: np.ndarray
    radius: int

    @classmethod
    def of(cls, views: StackedViews, among: np.ndarray, count: int, rng: np.random.Generator) -> Drawn:
        """Draw from the pixels `among`; see `sample_of`."""
        pixels = sample_of(views, among, count, rng)
        view = np.searchsorted(views.starts, pixels, side="right") - 1
        return cls(pixels, view, views.positions()[pixels], max(2, round(NEAR * views.side)))

    def pairs(self, albedo: np.ndarray, rng: np.random.Generator) -> Pairs:
        """Pair them by what their albedo, (n, 3), seems to be; see `alike_pairs`."""
        return alike_pairs(albedo, self.views, self.positions, self.radius, rng)


def sample_of(views: StackedViews, among: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Some of the pixels `among`, (n,), sorted: evenly from those with four neighbours in their view."""
    inner = np.concatenate([_inner(mask)[mask] for mask in views.masks])[among]
    chosen = among[inner] if inner.any() else among
    return np.sort(rng.choice(chosen, min(count, chosen.size), replace=False))


def alike_pairs(
    albedo: np.ndarray, views: np.ndarray, positions: np.ndarray, radius: int, rng: np.random.Generator
) -> Pairs:
    """Pair the pixels of a sample, half of the weight on either kind of pairs.

    Parameters
    ----------
    albedo : ndarray, shape (n, 3)
        The best guess: the image itself at first. Its chromaticity is looked at.
    views : ndarray, shape (n,)
        Number of the view that each pixel belongs to.
    positions : ndarray, shape (n, 2)
        Row and column there.
    radius : int
        Side of the squares in which pixels are near, px.
    rng : numpy.random.Generator
    """
    same_colour = _partners(_colour_of(albedo), rng)
    cells = np.column_stack([views, (positions + rng.integers(0, radius, 2)) // radius])
    near = _partners(np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1), rng)
    kinds = [kind for kind in (same_colour, near) if len(kind)]
    weights = [np.full(len(kind), 1 / (len(kinds) * len(kind))) for kind in kinds]
    if not kinds:
        return Pairs(np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0))
    both = np.concatenate(kinds).astype(np.int32)
    return Pairs(both[:, 0].copy(), both[:, 1].copy(), np.concatenate(weights))


def _colour_of(albedo: np.ndarray) -> np.ndarray:
    """Number of the chromaticity's cell, (n,)."""
    cells = np.floor(chroma_of(albedo) / COLOUR_CELL).astype(np.int64)
    return np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)


def _partners(group: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Pairs within groups, (m, 2): every pixel with the next few of its group in a random order."""
    order = np.lexsort((rng.random(group.size), group))
    pairs = []
    for step in range(1, PARTNERS + 1):
        one, other = order[:-step], order[step:]
        alike = group[one] == group[other]
        pairs.append(np.column_stack([one[alike], other[alike]]))
    return np.concatenate(pairs)


def _inner(mask: np.ndarray) -> np.ndarray:
    padded = np.pad(mask, 1)
    return mask & padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
