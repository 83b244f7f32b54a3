"""Pairs of pixels that are likely to have equal albedo: near one another, or of equal chromaticity."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from stages.photometry.chromaticity import chroma_of
from stages.photometry.light_search.settings import PairSettings
from stages.photometry.stack import StackedViews

COLOUR = 0  # the kind of pairs of equal chromaticity


@dataclass(frozen=True, eq=False)
class Pairs:
    """Weighted pairs of pixels of a sample.

    Attributes
    ----------
    first, second : ndarray, shape (m,), int32
    weight : ndarray, shape (m,)
        Sums to 1.
    kind : ndarray, shape (m,), int32
        0 for equal chromaticity; 1 for near one another in the smallest squares, 2 in larger ones, and so on.
    """

    first: np.ndarray
    second: np.ndarray
    weight: np.ndarray
    kind: np.ndarray

    @property
    def kinds(self) -> list[int]:
        """Kinds that occur, sorted."""
        return np.unique(self.kind).tolist()

    def count(self, kind: int) -> int:
        """Count the pairs of a kind."""
        return int((self.kind == kind).sum())

    def of_kind(self, kind: int) -> Pairs:
        """Select the pairs of a kind that occurs, with equal weights."""
        own, count = self.kind == kind, self.count(kind)
        return Pairs(self.first[own], self.second[own], np.full(count, 1 / count), self.kind[own])

    def weighted(self, of_colour: float, reliability: Mapping[int, float] | None = None) -> Pairs:
        """Give pairs of equal chromaticity this share of the weight, and near pairs the rest.

        Within near pairs the weight is proportional to the reliability of their kind, 1 by default. Where
        pairs of equal chromaticity or near pairs are missing, the others have all weight.
        """
        colour = (self.kind == COLOUR).astype(np.float64)
        near = 1 - colour
        for kind, each in (reliability or {}).items():
            near[self.kind == kind] = each
        share = of_colour if colour.any() and near.any() else float(colour.any())
        weight = share * colour / max(colour.sum(), 1)
        weight += (1 - share) * near / max(near.sum(), 1e-12)
        return replace(self, weight=weight)


@dataclass(frozen=True, eq=False)
class PixelSample:
    """Sample of n pixels of all views, with their positions.

    Attributes
    ----------
    pixels : ndarray, shape (n,)
        Their indices in the stack, sorted.
    views : ndarray, shape (n,)
        Number of the view that each belongs to.
    positions : ndarray, shape (n, 2)
        Row and column there.
    places : ndarray, shape (n, 3)
        Surface points, world axes; not a number where unknown.
    squares : tuple of int
        Sides of the squares in which pixels are near, px.
    how : PairSettings
    """

    pixels: np.ndarray
    views: np.ndarray
    positions: np.ndarray
    places: np.ndarray
    squares: tuple[int, ...]
    how: PairSettings

    @classmethod
    def of(
        cls,
        views: StackedViews,
        places: Callable[[np.ndarray], np.ndarray],
        among: np.ndarray,
        count: int,
        rng: np.random.Generator,
        how: PairSettings,
    ) -> PixelSample:
        """Draw from the pixels `among`, (m,); see `sample_of`. `places`: see `LitScene.places`."""
        pixels = sample_of(views, among, count, rng, how.thin_share)
        view = np.searchsorted(views.starts, pixels, side="right") - 1
        sides = {max(how.smallest_square, round(side * views.side)) for side in how.square_sides}
        return cls(pixels, view, views.positions()[pixels], places(pixels), tuple(sorted(sides)), how)

    def pairs(self, albedo: np.ndarray, rng: np.random.Generator) -> Pairs:
        """Pair the pixels by their estimated albedo, (n, 3); see `alike_pairs`."""
        return alike_pairs(albedo, self.views, self.positions, self.places, self.squares, rng, self.how)


def sample_of(
    views: StackedViews, among: np.ndarray, count: int, rng: np.random.Generator, thin_share: float
) -> np.ndarray:
    """Draw from the pixels `among`, uniformly from those with four neighbours in their view: (n,), sorted.

    All are drawn from where these are no more than `thin_share` of them.
    """
    inner = np.concatenate([_inner(mask)[mask] for mask in views.masks])[among]
    chosen = among[inner] if inner.sum() > thin_share * among.size else among
    return np.sort(rng.choice(chosen, min(count, chosen.size), replace=False))


def alike_pairs(
    albedo: np.ndarray,
    views: np.ndarray,
    positions: np.ndarray,
    places: np.ndarray,
    squares: tuple[int, ...],
    rng: np.random.Generator,
    how: PairSettings,
) -> Pairs:
    """Pair pixels of equal chromaticity, with `compared_share` of the weight, and near pixels.

    Near pixels are close in the image and on the surface: an object and the floor behind it differ in albedo.

    Parameters
    ----------
    albedo : ndarray, shape (n, 3)
        Current estimate: the image itself at first. Only its chromaticity is used.
    views : ndarray, shape (n,)
        Number of the view that each pixel belongs to.
    positions : ndarray, shape (n, 2)
        Row and column there.
    places : ndarray, shape (n, 3)
        Surface points, world axes; not a number where unknown.
    squares : tuple of int
        Sides of the squares in which pixels are near, px, from small to large.
    rng : numpy.random.Generator
    how : PairSettings
    """
    groups = [
        _colour_of(albedo, how.chromaticity_cell),
        *(_square_of(views, positions, side, rng) for side in squares),
    ]
    colour, *near = (_partners(group, how.partners, rng) for group in groups)
    partners = [colour, *(_on_one_surface(pairs, views, places, how.outline_distance) for pairs in near)]
    both = np.concatenate(partners).astype(np.int32)
    kind = np.repeat(np.arange(len(partners), dtype=np.int32), [len(own) for own in partners])
    pairs = Pairs(both[:, 0].copy(), both[:, 1].copy(), np.zeros(len(both)), kind)
    return pairs.weighted(how.compared_share)


def _colour_of(albedo: np.ndarray, cell: float) -> np.ndarray:
    """Number the cell of each pixel's chromaticity, (n,)."""
    cells = np.floor(chroma_of(albedo) / cell).astype(np.int64)
    return _numbered(cells)


def _square_of(views: np.ndarray, positions: np.ndarray, side: int, rng: np.random.Generator) -> np.ndarray:
    """Number the square of its view that contains each pixel, (n,); the squares' origin is random."""
    squares = np.column_stack([views, (positions + rng.integers(0, side, 2)) // side])
    return _numbered(squares)


def _numbered(rows: np.ndarray) -> np.ndarray:
    """Number equal rows of integers, (n, k), in their order, (n,): as `np.unique` by rows, but fast."""
    least = rows.min(axis=0)
    keys = np.ravel_multi_index((rows - least).T, rows.max(axis=0) - least + 1)
    return np.unique(keys, return_inverse=True)[1]


def _partners(group: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Pair every pixel with the next few of its group in a random order, (m, 2)."""
    order = np.lexsort((rng.random(group.size), group))
    pairs = []
    for step in range(1, count + 1):
        one, other = order[:-step], order[step:]
        alike = group[one] == group[other]
        pairs.append(np.column_stack([one[alike], other[alike]]))
    return np.concatenate(pairs)


def _on_one_surface(
    pairs: np.ndarray, views: np.ndarray, places: np.ndarray, outline_distance: float
) -> np.ndarray:
    """Select near pairs, (m, 2), not much farther apart on the surface than the median of their view."""
    apart = np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1)
    view, kept = views[pairs[:, 0]], np.ones(len(pairs), bool)
    for own in (np.flatnonzero(view == one) for one in np.unique(view)):
        known = apart[own][np.isfinite(apart[own])]
        if known.size:
            kept[own] = ~(apart[own] > outline_distance * np.median(known))
    return pairs[kept]


def _inner(mask: np.ndarray) -> np.ndarray:
    padded = np.pad(mask, 1)
    return mask & padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
