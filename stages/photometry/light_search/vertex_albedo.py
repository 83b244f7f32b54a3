"""Albedo of the mesh's vertices under a light, and the interreflection between them."""

from __future__ import annotations

import numpy as np

from stages.photometry.transport.interreflection import bounced
from stages.photometry.transport.lit_scenes import LitScene
from stages.solvers.kernels.sparse_rows import product

NO_LIGHT = 1e-6  # of the scaled image's unit: surface with less light does not constrain its albedo


def vertex_albedo(scene: LitScene, image: np.ndarray, shading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate the albedo of the vertices, with the light that weights it, (P, 3) each.

    ``ρ = Σ b I / Σ b S`` over the pixels around a vertex, b their blend weights: dark pixels count little.
    """
    seen, light = product(scene.to_vertices, image), product(scene.to_vertices, shading)
    return np.where(light > NO_LIGHT, seen / np.maximum(light, NO_LIGHT), 0), light


def brightest_albedo(albedo: np.ndarray, light: np.ndarray, quantile: float) -> float:
    """Compute a high quantile of the albedo over all channels, weighted by light."""
    order = np.argsort(albedo, axis=None)
    upto = np.cumsum(light.ravel()[order], dtype=np.float64)
    if upto.size == 0 or upto[-1] <= 0:
        return 1.0
    bright = float(albedo.ravel()[order][np.searchsorted(upto, quantile * upto[-1])])
    return bright if bright > 0 else 1.0


def bounced_at_vertices(
    scene: LitScene, direct: np.ndarray, absolute: np.ndarray, light: np.ndarray, bounces: int
) -> np.ndarray:
    """Compute the vertices' shading by interreflection under each light: (G, P, 3), float32."""
    count, vertices, _ = direct.shape
    lit = light > NO_LIGHT
    typical = np.array([np.median(a[b]) if b.any() else 0 for a, b in zip(absolute.T, lit.T, strict=True)])
    albedo, of_backs = np.where(lit, absolute, typical).astype(np.float32), typical.astype(np.float32)
    own = direct.transpose(1, 0, 2).reshape(vertices, 3 * count)  # all lights and channels at once
    total = bounced(own, scene.proxy.occlusion, np.tile(albedo, count), np.tile(of_backs, count), bounces)
    return np.ascontiguousarray((total - own).reshape(vertices, count, 3).transpose(1, 0, 2))
