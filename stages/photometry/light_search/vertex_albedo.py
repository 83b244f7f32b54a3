"""Albedo of the mesh's vertices under a light, and the interreflection between them."""

from __future__ import annotations

import numpy as np

from stages.photometry.transport.interreflection import bounced
from stages.photometry.transport.lit_scenes import LitScene

NO_LIGHT = 1e-6  # of the scaled image's unit: surface with less light does not constrain its albedo


def vertex_albedo(scene: LitScene, image: np.ndarray, shading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate the albedo of the vertices, with the light that weights it, (P, 3) each.

    ``ρ = Σ b I / Σ b S`` over the pixels around a vertex, b their blend weights: dark pixels count little.
    """
    to_vertices = scene.pixels.blend.T.tocsr()
    seen, light = to_vertices @ image, to_vertices @ shading
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
    at_vertices = np.empty_like(direct)
    for c in range(3):
        lit = light[:, c] > NO_LIGHT
        typical = float(np.median(absolute[lit, c])) if lit.any() else 0.0
        albedo = np.where(lit, absolute[:, c], typical).astype(np.float32)
        from_sky = np.ascontiguousarray(direct[:, :, c].T)  # all lights at once
        total = bounced(from_sky, scene.proxy.occlusion, albedo, typical, bounces)
        at_vertices[:, :, c] = (total - from_sky).T
    return at_vertices
