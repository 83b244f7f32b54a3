"""Pairs of pixels that are likely to show the same paint: near one another, or of the same chromaticity."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from stages.photometry.chromaticity import chroma_of
from stages.photometry.stack import StackedViews

# Of the logarithms of red and blue over green: colours in one cell of this size pass for one. Pairs are drawn
# for the light; `decomposition.edges.chroma_step` says what passes for an edge of paint under a known light.
COLOUR_CELL = 0.12
THIN = 0.1  # of the pixels: where fewer have four neighbours, the others are drawn as well
PARTNERS = 4  # of each kind, per pixel
# Of a view's side, squares of pixels that are likely to be of one paint: small ones, for where that changes
# softly, and larger ones, since within smooth surface what is nearer hardly differs by its light.
NEAR = (0.03, 0.06, 0.12)
SMALLEST = 3  # px: in smaller ones pixels share their light as well as their paint
APART = 3.0  # median distances of a kind in a view: what is farther apart lies at two sides of an outline
COLOUR = 0  # the kind of pairs that are of one colour


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pixels of a sample, two by two.

    Attributes
    ----------
    first, second : ndarray, shape (m,), int32
    weight : ndarray, shape (m,)
        How much every pair counts; sums to 1.
    kind : ndarray, shape (m,), int32
        What they are paired for: being of one colour, 0; or near one another, 1 in the smallest squares, 2 in
        larger ones, and so on.
    """

    first: np.ndarray
    second: np.ndarray
    weight: np.ndarray
    kind: np.ndarray

    @property
    def kinds(self) -> list[int]:
        """Those of which there are some, sorted."""
        return np.unique(self.kind).tolist()

    def count(self, kind: int) -> int:
        """How many there are of a kind."""
        return int((self.kind == kind).sum())

    def of_kind(self, kind: int) -> Pairs:
        """Those of one kind, of which there are some, alone and alike."""
        own, count = self.kind == kind, self.count(kind)
        return Pairs(self.first[own], self.second[own], np.full(count, 1 / count), self.kind[own])

    def weighted(self, of_colour: float, worth: Mapping[int, float] | None = None) -> Pairs:
        """The same with this share of the weight on pairs of one colour, alike, and the rest on near ones.

        By what one of each kind is worth; 1 if nothing is said. Where there are none of one colour, or none
        that are near, the others have it all.
        """
        colour = (self.kind == COLOUR).astype(np.float64)
        near = 1 - colour
        for kind, each in (worth or {}).items():
            near[self.kind == kind] = each
        share = of_colour if colour.any() and near.any() else float(colour.any())
        weight = share * colour / max(colour.sum(), 1)
        weight += (1 - share) * near / max(near.sum(), 1e-12)
        return replace(self, weight=weight)


@dataclass(frozen=True, eq=False)
class PixelSample:
    """Some of the pixels of all views, n, and where they are.

    Attributes
    ----------
    pixels : ndarray, shape (n,)
        Their places in the stack, sorted.
    views : ndarray, shape (n,)
        Number of the view that each belongs to.
    positions : ndarray, shape (n, 2)
        Row and column there.
    places : ndarray, shape (n, 3)
        Where on the surface they are, world axes; not a number where that is not known.
    squares : tuple of int
        Sides of the squares in which pixels are near, px.
    """

    pixels: np.ndarray
    views: np.ndarray
    positions: np.ndarray
    places: np.ndarray
    squares: tuple[int, ...]

    @classmethod
    def of(
        cls,
        views: StackedViews,
        places: Callable[[np.ndarray], np.ndarray],
        among: np.ndarray,
        count: int,
        rng: np.random.Generator,
    ) -> PixelSample:
        """Draw from the pixels `among`, (m,); see `sample_of`. `places`: see `LitScene.places`."""
        pixels = sample_of(views, among, count, rng)
        view = np.searchsorted(views.starts, pixels, side="right") - 1
        squares = tuple(sorted({max(SMALLEST, round(near * views.side)) for near in NEAR}))
        return cls(pixels, view, views.positions()[pixels], places(pixels), squares)

    def pairs(self, albedo: np.ndarray, rng: np.random.Generator) -> Pairs:
        """Pair them by what their albedo, (n, 3), seems to be; see `alike_pairs`."""
        return alike_pairs(albedo, self.views, self.positions, self.places, self.squares, rng)


def sample_of(views: StackedViews, among: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Some of the pixels `among`, (n,), sorted: evenly from those with four neighbours in their view.

    Of surface so thin that these are few, from all.
    """
    inner = np.concatenate([_inner(mask)[mask] for mask in views.masks])[among]
    chosen = among[inner] if inner.sum() > THIN * among.size else among
    return np.sort(rng.choice(chosen, min(count, chosen.size), replace=False))


def alike_pairs(
    albedo: np.ndarray,
    views: np.ndarray,
    positions: np.ndarray,
    places: np.ndarray,
    squares: tuple[int, ...],
    rng: np.random.Generator,
) -> Pairs:
    """Pair the pixels of a sample, half of the weight on those of one colour, half on those that are near.

    In the image, and on the surface as well: a thing and the floor behind it are not of one paint.

    Parameters
    ----------
    albedo : ndarray, shape (n, 3)
        The best guess: the image itself at first. Its chromaticity is looked at.
    views : ndarray, shape (n,)
        Number of the view that each pixel belongs to.
    positions : ndarray, shape (n, 2)
        Row and column there.
    places : ndarray, shape (n, 3)
        Where on the surface they are, world axes; not a number where that is not known.
    squares : tuple of int
        Sides of the squares in which pixels are near, px, from small to large.
    rng : numpy.random.Generator
    """
    groups = [_colour_of(albedo), *(_square_of(views, positions, side, rng) for side in squares)]
    colour, *near = (_partners(group, rng) for group in groups)
    partners = [colour, *(_on_one_surface(pairs, views, places) for pairs in near)]
    both = np.concatenate(partners).astype(np.int32)
    kind = np.repeat(np.arange(len(partners), dtype=np.int32), [len(own) for own in partners])
    return Pairs(both[:, 0].copy(), both[:, 1].copy(), np.zeros(len(both)), kind).weighted(0.5)


def _colour_of(albedo: np.ndarray) -> np.ndarray:
    """Number of the chromaticity's cell, (n,)."""
    cells = np.floor(chroma_of(albedo) / COLOUR_CELL).astype(np.int64)
    return np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)


def _square_of(views: np.ndarray, positions: np.ndarray, side: int, rng: np.random.Generator) -> np.ndarray:
    """Number of the square of its view that a pixel lies in, (n,); the squares begin anywhere."""
    squares = np.column_stack([views, (positions + rng.integers(0, side, 2)) // side])
    return np.unique(squares, axis=0, return_inverse=True)[1].reshape(-1)


def _partners(group: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Pairs within groups, (m, 2): every pixel with the next few of its group in a random order."""
    order = np.lexsort((rng.random(group.size), group))
    pairs = []
    for step in range(1, PARTNERS + 1):
        one, other = order[:-step], order[step:]
        alike = group[one] == group[other]
        pairs.append(np.column_stack([one[alike], other[alike]]))
    return np.concatenate(pairs)


def _on_one_surface(pairs: np.ndarray, views: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Of pairs that are near in their view, (m, 2), those that are not much farther apart than most there."""
    apart = np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1)
    view, kept = views[pairs[:, 0]], np.ones(len(pairs), bool)
    for own in (np.flatnonzero(view == one) for one in np.unique(view)):
        known = apart[own][np.isfinite(apart[own])]
        if known.size:
            kept[own] = ~(apart[own] > APART * np.median(known))
    return pairs[kept]


def _inner(mask: np.ndarray) -> np.ndarray:
    padded = np.pad(mask, 1)
    return mask & padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
