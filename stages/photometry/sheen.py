"""Sheen: the image of the light in a surface that is a little of a mirror, as far as the light is known.

Where every view sees some of it, no view shows the paint alone; but how views differ tells how much it is,
and of which paints.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from stages.photometry.sky import SkyTransport
from stages.photometry.stack import Pixels, StackedViews

ROUGHNESSES = (0.15, 0.2, 0.3)  # α of GGX: a sharper lobe falls between 256 directions
LINKS = 100_000  # that are looked at, or up to twice as many
FEWEST = 1000  # of them: what fewer differ by is as well explained by chance
LIT = 0.1  # of the mean shading, per channel: what a link's ends have at least
ROUNDS = 10  # of reweighting
FITTED = 0.01  # of the scaled image: differences below this count as explained
BELIEVED = 0.98  # of the views' differences; a sheen that leaves more is none
STRONGEST = 0.5  # of a mirror: more is no sheen on paint, but views too near one another to tell
KEPT = 0.2  # of the image, at least: highlights that lie a little beside where they are expected
HIGHLIGHT, BRIGHTER = 0.25, 3.0  # of a pixel's brightness; of what any other view has there


@dataclass(frozen=True, eq=False)
class Sheen:
    """How much of a mirror the surface is.

    Attributes
    ----------
    strength : ndarray, shape (3,)
        k of each channel: what the mirror adds, of the light that it shows. It holds the unknown scale that
        the light has against the albedo.
    roughness : float
        α.
    left : float
        What it leaves of the differences between views: 1 where there is no sheen.
    """

    strength: np.ndarray
    roughness: float
    left: float

    @property
    def unexplained(self) -> float:
        """What is left of the differences: all of them where no sheen is so strong."""
        return self.left if self.strength.max() < STRONGEST else 1.0

    @property
    def believed(self) -> bool:
        """Whether it explains enough to be there."""
        return self.unexplained < BELIEVED


NO_SHEEN = Sheen(np.zeros(3), ROUGHNESSES[0], 1.0)


@dataclass(frozen=True, eq=False)
class PaintedSheen:
    """The sheen of every paint.

    Attributes
    ----------
    paint : ndarray, shape (N,), int32
        Number of every pixel's paint.
    of_paint : tuple of Sheen
    """

    paint: np.ndarray
    of_paint: tuple[Sheen, ...]

    @classmethod
    def of_all(cls, sheen: Sheen, pixels: int) -> PaintedSheen:
        """The same of all pixels."""
        return cls(np.zeros(pixels, np.int32), (sheen,))

    @property
    def believed(self) -> bool:
        """Whether any paint has some."""
        return any(sheen.believed for sheen in self.of_paint)

    @property
    def ruled_out(self) -> bool:
        """Whether it was looked for, and there was none."""
        return bool(self.of_paint) and not self.believed

    def image(self, mirror: Mirror) -> np.ndarray:
        """What the sheen adds to the image, (N, 3), float32."""
        added = np.zeros((len(self.paint), 3), np.float32)
        for number, sheen in enumerate(self.of_paint):
            if sheen.believed:
                own = np.flatnonzero(self.paint == number)
                added[own] = sheen.strength.astype(np.float32) * mirror.image(sheen.roughness, own)
        return added

    def as_json(self) -> list[dict[str, Any]]:
        """For machines: every paint that has some, and how many pixels that is."""
        return [
            {
                "pixels": int(np.count_nonzero(self.paint == number)),
                "strength": [round(float(k), 4) for k in sheen.strength],
                "roughness": sheen.roughness,
                "left": round(sheen.left, 3),
            }
            for number, sheen in enumerate(self.of_paint)
            if sheen.believed
        ]


NOT_SOUGHT = PaintedSheen(np.empty(0, np.int32), ())


@dataclass(frozen=True, eq=False)
class Mirror:
    """What there is to be seen in the surface: points (N), light of M directions, ways to the cameras."""

    pixels: SkyTransport
    radiance: np.ndarray
    towards: np.ndarray

    def image(self, roughness: float, points: np.ndarray) -> np.ndarray:
        """H of chosen points, (n, 3), float32; see `SkyTransport.mirrored`."""
        return self.pixels.mirrored(self.radiance, self.towards, roughness, points)


@dataclass(frozen=True, eq=False)
class Differences:
    """How views differ along links, and how mirrors would make them differ.

    Attributes
    ----------
    p, q : ndarray, shape (L,)
        Pixels.
    seen : ndarray, shape (L, 3)
        ``I_p − f I_q`` with ``f = S_p / S_q``.
    mirrored : tuple of ndarray, shape (L, 3)
        ``H_p − f H_q`` of every roughness.
    """

    p: np.ndarray
    q: np.ndarray
    seen: np.ndarray
    mirrored: tuple[np.ndarray, ...]

    @classmethod
    def of(
        cls, views: StackedViews, seen: np.ndarray, shading: np.ndarray, trusted: np.ndarray, mirror: Mirror
    ) -> Differences:
        """Along some of the links between pixels that are trusted, and lit in every channel.

        Parameters
        ----------
        views : StackedViews
        seen : ndarray, shape (N, 3)
            The image, gains of the views divided out, all views in one light.
        shading : ndarray, shape (N, 3)
            By that light.
        trusted : ndarray, shape (N,), bool
        mirror : Mirror
        """
        useful = trusted & (shading > LIT * shading.mean(axis=0)).all(axis=1)
        p, q = _some_links(views, useful)
        f = shading[p] / shading[q]
        mirrored = (mirror.image(roughness, p) - f * mirror.image(roughness, q) for roughness in ROUGHNESSES)
        return cls(p, q, seen[p] - f * seen[q], tuple(mirrored))

    @cached_property
    def sheen(self) -> Sheen:
        """The sheen of all surface that explains best how views differ.

        Notes
        -----
        Minimises ``Σ |I_p − f I_q − k (H_p − f H_q)|``, per channel, k ≥ 0, by reweighted least squares, for
        each of some roughnesses. What all views have in common of the sheen is foretold, too, though the
        links know nothing of it.
        """
        if self.p.size < FEWEST:
            return NO_SHEEN
        found = (_fitted(self.seen, *one) for one in zip(self.mirrored, ROUGHNESSES, strict=True))
        return min(found, key=lambda one: one.left)

    def sheen_of(self, paint: np.ndarray) -> PaintedSheen:
        """The sheen of every paint by itself, (N,) their numbers: what is matt hides that of the rest."""
        numbers = range(int(paint.max(initial=-1)) + 1)
        return PaintedSheen(paint, tuple(self._within(paint, number).sheen for number in numbers))

    def _within(self, paint: np.ndarray, number: int) -> Differences:
        both = (paint[self.p] == number) & (paint[self.q] == number)
        mirrored = tuple(one[both] for one in self.mirrored)
        return Differences(self.p[both], self.q[both], self.seen[both], mirrored)


def without_sheen(seen: np.ndarray, added: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The image without its sheen, (N, 3), nowhere above it; the sheen's share of the brightness, (N,).

    `added` is what the sheen adds, (N, 3), float32.
    """
    share = added.mean(axis=1) / np.maximum(seen.mean(axis=1), FITTED)
    return np.maximum(seen - added, np.minimum(seen, KEPT * seen)), share


def highlights_of(views: StackedViews, share: np.ndarray, trusted: np.ndarray) -> np.ndarray:
    """Pixels whose sheen has so large a share that another view, which has far less, knows better, (N,)."""
    least = np.full(len(share), np.inf, np.float32)
    for one, other in views.linked_pixels():
        both = trusted[one] & trusted[other]
        for own, there in ((one[both], other[both]), (other[both], one[both])):
            np.minimum.at(least, own, share[there])
    return (share > HIGHLIGHT) & (share > BRIGHTER * least)


def _fitted(apart: np.ndarray, mirrored: np.ndarray, roughness: float) -> Sheen:
    weight = np.ones_like(apart)
    for _ in range(ROUNDS):
        squares = np.maximum((weight * mirrored**2).sum(axis=0), 1e-12)
        strength = np.maximum((weight * apart * mirrored).sum(axis=0) / squares, 0)
        weight = 1 / np.maximum(np.abs(apart - strength * mirrored), FITTED)
    before, after = np.abs(apart).sum(), np.abs(apart - strength * mirrored).sum()
    return Sheen(strength, roughness, float(after / before) if before > 0 else 1.0)


def _some_links(views: StackedViews, useful: np.ndarray) -> Pixels:
    """Every so many-th link, if both its ends are of use."""
    stride = max(1, views.link_count // LINKS)
    nobody = np.empty(0, np.int64)
    ends = [(nobody, nobody), *((one[::stride], other[::stride]) for one, other in views.linked_pixels())]
    one, other = (np.concatenate(side) for side in zip(*ends, strict=True))
    both = useful[one] & useful[other]
    return one[both], other[both]
