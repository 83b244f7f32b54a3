"""Specular reflection: the mirror image of the light in partly specular surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stages.photometry.specular.chromaticity_clusters import ChromaticityClusters
from stages.photometry.specular.ggx_lobes import mirrored_light
from stages.photometry.specular.linked_kernels import lower_to_linked
from stages.photometry.specular.settings import SpecularSettings
from stages.photometry.stack import StackedViews
from stages.photometry.transport.directional_transport import DirectionalTransport


@dataclass(frozen=True, eq=False)
class GlossyPaints:
    """Glossy clusters of albedo.

    Attributes
    ----------
    clusters : ChromaticityClusters
    numbers : tuple of int
        Of those that are glossy.
    light : LightEstimate
        Under which they were found, in the scene of the reflection.
    """

    clusters: ChromaticityClusters
    numbers: tuple[int, ...]
    light: Any


@dataclass(frozen=True, eq=False)
class SpecularReflection:
    """Parameters of the specular reflection of some surface.

    Attributes
    ----------
    strength : ndarray, shape (3,)
        k of each channel: reflected radiance per mean radiance in the lobe. It contains the unknown scale of
        the light against the albedo.
    roughness : float
        α.
    left : float
        Share of the view differences of that surface that remains: 1 would be no reflection.
    glossy : ndarray, shape (N,), bool
        Pixels of that surface.
    paints : GlossyPaints or None
        Clusters of albedo that it consists of; None: it is all surface.
    """

    strength: np.ndarray
    roughness: float
    left: float
    glossy: np.ndarray
    paints: GlossyPaints | None = None

    def image(self, mirror: Mirror) -> np.ndarray:
        """Compute the specular component of the image, (N, 3), float32."""
        added, own = np.zeros((len(self.glossy), 3), np.float32), np.flatnonzero(self.glossy)
        added[own] = self.strength.astype(np.float32) * mirror.image(self.roughness, own)
        return added

    def bounded(
        self, seen: np.ndarray, trusted: np.ndarray, mirror: Mirror, how: SpecularSettings
    ) -> SpecularReflection:
        """Lower the strength to what trusted pixels, (N,), of an image, (N, 3), show.

        No surface shows less than it reflects. Differences between views determine how the reflection varies,
        and hardly its constant part, which alone may be more than what dark paint shows.
        """
        own = np.flatnonzero(self.glossy & trusted)
        own = own[:: max(1, len(own) // how.bounding_samples)]
        reflected = self.strength * mirror.image(self.roughness, own)
        lit = reflected.min(axis=1) > 0
        if not lit.any():
            return self
        shown = np.quantile(seen[own][lit] / reflected[lit], how.overshot_share, axis=0).min()
        return self if shown >= 1 else replace(self, strength=self.strength * max(0.0, float(shown)))

    def as_json(self) -> dict[str, Any]:
        """Convert to plain values for records; of `glossy`, only its size."""
        return {
            "pixels": int(np.count_nonzero(self.glossy)),
            "strength": [round(float(k), 4) for k in self.strength],
            "roughness": self.roughness,
            "left": round(self.left, 3),
        }


@dataclass(frozen=True, eq=False)
class Mirror:
    """Mirror image of light from M directions at N points: transport, radiance, directions to the cameras."""

    pixels: DirectionalTransport
    radiance: np.ndarray
    towards: np.ndarray

    def image(self, roughness: float, points: np.ndarray) -> np.ndarray:
        """Compute H of chosen points, (n, 3), float32; see `mirrored_light`."""
        return mirrored_light(self.pixels, self.radiance, self.towards, roughness, points)


def without_specular(
    seen: np.ndarray, added: np.ndarray, how: SpecularSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Subtract specular reflection from an image, (N, 3) each; return also its share of brightness, (N,).

    The image never becomes brighter.
    """
    share = added.mean(axis=1) / np.maximum(seen.mean(axis=1), how.min_brightness)
    return np.maximum(seen - added, np.minimum(seen, how.kept_share * seen)), share


def highlights_of(
    views: StackedViews, share: np.ndarray, trusted: np.ndarray, how: SpecularSettings
) -> np.ndarray:
    """Detect pixels with a large specular share whose correspondences include one of far less, (N,)."""
    least = np.full(len(share), np.inf, np.float32)
    for pair in views.linked_rows():
        lower_to_linked(*pair, trusted, share, least)
    return (share > how.highlight_share) & (share > how.highlight_ratio * least)
