"""`mode: transfer`: a light from all around, how it is looked for, and what it makes of a scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stages.photometry.light_search.light_from_pairs import PairWeights
from stages.photometry.transport.lit_scenes import LitScene


@dataclass(frozen=True)
class LightSearchSettings:
    """How the light is looked for.

    Attributes
    ----------
    bounces : int
        How often light is passed on between surfaces.
    samples : int
        Pixels that it is found from; as many again per light beyond the first, divided by four.
    scales : tuple of float
        See `light_from_pairs`: coarse first, as bounces find their place, and so that a sun's shadow, e times
        darker and more, is not at once taken for other paint; then finer.
    brightest : float or None
        What the brightest material reflects. None where light and images are in one unit, and the scale of
        the albedo is known.
    weights : PairWeights
    seed : int
        Of the sample.
    """

    bounces: int
    samples: int = 20_000
    scales: tuple[float, ...] = (2.4, 1.2, 0.6, 0.4, 0.4)
    brightest: float | None = 0.9
    weights: PairWeights = PairWeights()
    seed: int = 0


@dataclass(frozen=True, eq=False)
class LightEstimate:
    """A light, and what it makes of the vertices.

    Attributes
    ----------
    radiance : ndarray, shape (G, M, 3)
        From every direction, at least 0.
    bounced : ndarray, shape (G, P, 3)
        Shading of the vertices by what comes from other surface.
    """

    radiance: np.ndarray
    bounced: np.ndarray

    def shading(self, scene: LitScene, starts: np.ndarray, light_of_view: np.ndarray) -> np.ndarray:
        """Of a scene's pixels, view after view from ``starts``, (N, 3), float32; bounces included."""
        direct = self.direct(scene, starts, light_of_view)
        direct += self.sent_on(scene, starts, light_of_view)
        return direct

    def direct(self, scene: LitScene, starts: np.ndarray, light_of_view: np.ndarray) -> np.ndarray:
        """The same without bounces."""
        out = np.empty((int(starts[-1]), 3), np.float32)
        for rows, own in _of_views(starts, light_of_view):
            out[rows] = scene.pixels.shading(self.radiance[own], rows)
        return out

    def sent_on(self, scene: LitScene, starts: np.ndarray, light_of_view: np.ndarray) -> np.ndarray:
        """The same by bounces alone."""
        out = np.empty((int(starts[-1]), 3), np.float32)
        for rows, own in _of_views(starts, light_of_view):
            out[rows] = scene.pixels.blend[rows] @ self.bounced[own]
        return out

    def shading_at(self, scene: LitScene, pixels: np.ndarray) -> np.ndarray:
        """Of chosen pixels under the first light, (n, 3), float32; bounces included."""
        chosen = scene.pixels.at(pixels)
        return chosen.shading(self.radiance[0]) + chosen.blend @ self.bounced[0]


def _of_views(starts: np.ndarray, light_of_view: np.ndarray) -> Iterator[tuple[slice, int]]:
    """Places of every view's pixels, and its light."""
    for view, own in enumerate(light_of_view):
        yield slice(int(starts[view]), int(starts[view + 1])), own
