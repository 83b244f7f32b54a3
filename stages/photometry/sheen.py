"""Sheen: the image of the light in a surface that is a little of a mirror, as far as the light is known.

Where every view sees some of it, no view shows the paint alone; but how views differ tells how much it is.
"""

from __future__ import annotations

from dataclasses import dataclass

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
    def believed(self) -> bool:
        """Whether it explains enough to be there."""
        return bool(self.left < BELIEVED and self.strength.max() < STRONGEST)


NO_SHEEN = Sheen(np.zeros(3), ROUGHNESSES[0], 1.0)


@dataclass(frozen=True, eq=False)
class Mirror:
    """What there is to be seen in the surface: points (N), light of M directions, ways to the cameras."""

    pixels: SkyTransport
    radiance: np.ndarray
    towards: np.ndarray

    def image(self, roughness: float, points: np.ndarray) -> np.ndarray:
        """H of chosen points, (n, 3), float32; see `SkyTransport.mirrored`."""
        return self.pixels.mirrored(self.radiance, self.towards, roughness, points)


def sheen_of(
    views: StackedViews, seen: np.ndarray, shading: np.ndarray, trusted: np.ndarray, mirror: Mirror
) -> Sheen:
    """Find the sheen that explains best how views differ.

    Parameters
    ----------
    views : StackedViews
    seen : ndarray, shape (N, 3)
        The image, gains of the views divided out, all views in one light.
    shading : ndarray, shape (N, 3)
        By that light.
    trusted : ndarray, shape (N,), bool
    mirror : Mirror

    Notes
    -----
    Of some of the links p, q minimises ``Σ |I_p − f I_q − k (H_p − f H_q)|`` with ``f = S_p / S_q``, per
    channel, k ≥ 0, by reweighted least squares, for each of some roughnesses. What all views have in common
    of the sheen is foretold, too, though the links know nothing of it.
    """
    useful = trusted & (shading > LIT * shading.mean(axis=0)).all(axis=1)
    p, q = _some_links(views, useful)
    if p.size < FEWEST:
        return NO_SHEEN
    f = shading[p] / shading[q]
    apart = seen[p] - f * seen[q]
    found = [
        _fitted(apart, mirror.image(roughness, p) - f * mirror.image(roughness, q), roughness)
        for roughness in ROUGHNESSES
    ]
    return min(found, key=lambda one: one.left)


def without_sheen(seen: np.ndarray, sheen: Sheen, mirror: Mirror) -> tuple[np.ndarray, np.ndarray]:
    """The image without its sheen, (N, 3), nowhere above it; the sheen's share of the brightness, (N,)."""
    added = sheen.strength.astype(np.float32) * mirror.image(sheen.roughness, np.arange(len(seen)))
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
