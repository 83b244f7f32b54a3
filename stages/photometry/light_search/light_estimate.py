"""`mode: transfer`: estimated light from all around, and the shading that it gives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stages.photometry.transport.lit_scenes import LitScene
from stages.solvers.kernels.sparse_rows import product


@dataclass(frozen=True, eq=False)
class LightEstimate:
    """Radiance of G lights, and the interreflection that it causes at the vertices.

    Attributes
    ----------
    radiance : ndarray, shape (G, M, 3)
        From every direction, at least 0.
    bounced : ndarray, shape (G, P, 3)
        Shading of the vertices by interreflection.
    """

    radiance: np.ndarray
    bounced: np.ndarray

    def shading(self, scene: LitScene, starts: np.ndarray, light_of_view: np.ndarray) -> np.ndarray:
        """Compute shading with bounces of pixels that are sorted by view from ``starts``, (N, 3), float32."""
        total = self.direct(scene, starts, light_of_view)
        total += self.interreflected(scene, starts, light_of_view)
        return total

    def direct(self, scene: LitScene, starts: np.ndarray, light_of_view: np.ndarray) -> np.ndarray:
        """Compute the shading without bounces."""
        out = np.empty((int(starts[-1]), 3), np.float32)
        for rows, own in _of_views(starts, light_of_view):
            out[rows] = scene.pixels.shading(self.radiance[own], rows)
        return out

    def interreflected(self, scene: LitScene, starts: np.ndarray, light_of_view: np.ndarray) -> np.ndarray:
        """Compute the shading by bounces alone."""
        out = np.empty((int(starts[-1]), 3), np.float32)
        for rows, own in _of_views(starts, light_of_view):
            out[rows] = product(scene.pixels.blend, self.bounced[own], rows)
        return out

    def shading_at(self, scene: LitScene, pixels: np.ndarray) -> np.ndarray:
        """Compute shading with bounces of chosen pixels under the first light, (n, 3), float32."""
        chosen = scene.pixels.at(pixels)
        return chosen.shading(self.radiance[0]) + product(chosen.blend, self.bounced[0])


def _of_views(starts: np.ndarray, light_of_view: np.ndarray) -> Iterator[tuple[slice, int]]:
    """Yield the slice of every view's pixels, and the index of its light."""
    for view, own in enumerate(light_of_view):
        yield slice(int(starts[view]), int(starts[view + 1])), own
