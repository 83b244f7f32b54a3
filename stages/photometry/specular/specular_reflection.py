"""Specular reflection: the image of the light in a surface that is a little of a mirror."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stages.photometry.specular.ggx_lobes import mirrored_light
from stages.photometry.specular.highlights import trusted_correspondences
from stages.photometry.specular.settings import SpecularSettings
from stages.photometry.stack import StackedViews
from stages.photometry.transport.directional_transport import DirectionalTransport


@dataclass(frozen=True, eq=False)
class SpecularReflection:
    """How much of a mirror some surface is.

    Attributes
    ----------
    strength : ndarray, shape (3,)
        k of each channel: what the mirror adds, of the light that it shows. It holds the unknown scale that
        the light has against the albedo.
    roughness : float
        α.
    left : float
        What it leaves of the differences between the views of that surface: 1 would be no reflection.
    glossy : ndarray, shape (N,), bool
        Which pixels show that surface.
    """

    strength: np.ndarray
    roughness: float
    left: float
    glossy: np.ndarray

    def image(self, mirror: Mirror) -> np.ndarray:
        """What the reflection adds to the image, (N, 3), float32."""
        added, own = np.zeros((len(self.glossy), 3), np.float32), np.flatnonzero(self.glossy)
        added[own] = self.strength.astype(np.float32) * mirror.image(self.roughness, own)
        return added

    def as_json(self) -> dict[str, Any]:
        """For machines; `glossy` only by its size."""
        return {
            "pixels": int(np.count_nonzero(self.glossy)),
            "strength": [round(float(k), 4) for k in self.strength],
            "roughness": self.roughness,
            "left": round(self.left, 3),
        }


@dataclass(frozen=True, eq=False)
class Mirror:
    """What there is to be seen in the surface: points (N), light of M directions, ways to the cameras."""

    pixels: DirectionalTransport
    radiance: np.ndarray
    towards: np.ndarray

    def image(self, roughness: float, points: np.ndarray) -> np.ndarray:
        """H of chosen points, (n, 3), float32; see `mirrored_light`."""
        return mirrored_light(self.pixels, self.radiance, self.towards, roughness, points)


def without_specular(
    seen: np.ndarray, added: np.ndarray, how: SpecularSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Take specular reflection off an image, (N, 3), never adding to it; also tell its share, (N,).

    The share is that of the brightness. `added` is what the reflection adds, (N, 3), float32.
    """
    share = added.mean(axis=1) / np.maximum(seen.mean(axis=1), how.min_brightness)
    return np.maximum(seen - added, np.minimum(seen, how.kept_share * seen)), share


def highlights_of(
    views: StackedViews, share: np.ndarray, trusted: np.ndarray, how: SpecularSettings
) -> np.ndarray:
    """Find pixels with so large a specular share that another view, of far less, knows better, (N,)."""
    least = np.full(len(share), np.inf, np.float32)
    for one, other in trusted_correspondences(views, trusted):
        for own, there in ((one, other), (other, one)):
            np.minimum.at(least, own, share[there])
    return (share > how.highlight_share) & (share > how.highlight_ratio * least)
