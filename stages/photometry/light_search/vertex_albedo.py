"""Albedo of the mesh's vertices under a light, and the light that they send one another by it."""

from __future__ import annotations

import numpy as np

from stages.photometry.transport.interreflection import bounced
from stages.photometry.transport.lit_scenes import LitScene

NO_LIGHT = 1e-6  # of the scaled image's unit: surface with less says nothing about its albedo


def vertex_albedo(scene: LitScene, image: np.ndarray, shading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Albedo of the vertices, and the light that it is known by, (P, 3) each.

    The photos' light over the shading's, all pixels around a vertex together: what is dark says little.
    """
    to_vertices = scene.pixels.blend.T.tocsr()
    seen, light = to_vertices @ image, to_vertices @ shading
    return np.where(light > NO_LIGHT, seen / np.maximum(light, NO_LIGHT), 0), light


def brightest_albedo(albedo: np.ndarray, known: np.ndarray, quantile: float) -> float:
    """A high quantile of all channels, weighted by the light that they are known by."""
    order = np.argsort(albedo, axis=None)
    upto = np.cumsum(known.ravel()[order], dtype=np.float64)
    if upto.size == 0 or upto[-1] <= 0:
        return 1.0
    bright = float(albedo.ravel()[order][np.searchsorted(upto, quantile * upto[-1])])
    return bright if bright > 0 else 1.0


def bounced_at_vertices(
    scene: LitScene, direct: np.ndarray, absolute: np.ndarray, known: np.ndarray, bounces: int
) -> np.ndarray:
    """Shading of the vertices by what other surface sends on, under each light: (G, P, 3), float32."""
    at_vertices = np.empty_like(direct)
    for c in range(3):
        lit = known[:, c] > NO_LIGHT
        typical = float(np.median(absolute[lit, c])) if lit.any() else 0.0
        albedo = np.where(lit, absolute[:, c], typical).astype(np.float32)
        from_sky = np.ascontiguousarray(direct[:, :, c].T)  # all lights at once
        total = bounced(from_sky, scene.proxy.occlusion, albedo, typical, bounces)
        at_vertices[:, :, c] = (total - from_sky).T
    return at_vertices
