"""`mode: transfer`: a light from all around, and what it makes of a scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stages.photometry.transport.lit_scenes import LitScene


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
