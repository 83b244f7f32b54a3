"""Shading of a mesh's vertices by a roughly known light, with normals that are not its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.transport.lit_scenes import LitScene


@dataclass(frozen=True, eq=False)
class LitVertices:
    """Vertices of a mesh in a light.

    Attributes
    ----------
    scene : LitScene
    light : LightEstimate
        One light.
    to_proxy : csr_array, shape (V, P)
        Every vertex as a blend of the proxy's, whose visibility it has.
    least : float
        Least shading, of its median: what is darker says nothing.
    """

    scene: LitScene
    light: LightEstimate
    to_proxy: sp.csr_array
    least: float

    def log_shading(self, normals: np.ndarray) -> np.ndarray:
        """Compute the logarithm of the shading, (V,), the mean of the channels, with unit normals, (V, 3)."""
        count = len(normals)
        pixels = self.scene.with_pixels(normals, self.to_proxy, np.zeros((count, 0), np.uint8))
        shading = self.light.shading(pixels, np.array([0, count]), np.zeros(1, np.int64))
        lit = shading[shading > 0]  # of closed objects half lies in the dark
        least = self.least * float(np.median(lit)) if len(lit) else 1.0
        logs: np.ndarray = np.log(np.maximum(shading, least)).mean(axis=1)
        return logs
