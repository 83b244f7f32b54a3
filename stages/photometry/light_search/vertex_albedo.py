"""Albedo of the mesh's vertices under a light, and the interreflection between them."""

from __future__ import annotations

import numpy as np

from stages.photometry.transport.interreflection import bounced
from stages.photometry.transport.lit_scenes import LitScene
from stages.photometry.transport.shown_radiance import NO_LIGHT
from stages.solvers.kernels.sparse_rows import product

FEW = 16  # of so many values one is sorted first, for the quantile: speed


def vertex_albedo(scene: LitScene, seen: np.ndarray, shading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate the albedo of the vertices, with the light that weights it, (P, 3) each.

    ``ρ = Σ b I / Σ b S`` over the pixels around a vertex, b their blend weights: dark pixels count little.
    `seen`, (P, 3), is Σ b I.
    """
    light = product(scene.to_vertices, shading)
    return np.where(light > NO_LIGHT, seen / np.maximum(light, NO_LIGHT), 0), light


def brightest_albedo(albedo: np.ndarray, light: np.ndarray, quantile: float) -> float:
    """Compute a high quantile of the albedo over all channels, weighted by light."""
    values, weights, total = albedo.ravel(), light.ravel(), float(light.sum(dtype=np.float64))
    if total <= 0:
        return 1.0
    count, above = 0, 0.0  # only the brightest are sorted
    while count == 0 or (above < (1 - quantile) * total and count < values.size):
        count = min(values.size, 4 * count or values.size // FEW + 1)
        brightest = np.argpartition(values, values.size - count)[values.size - count :]
        above = float(weights[brightest].sum(dtype=np.float64))
    order = brightest[np.argsort(values[brightest])]
    upto = total - above + np.cumsum(weights[order], dtype=np.float64)
    place = min(int(np.searchsorted(upto, quantile * total)), count - 1)
    bright = float(values[order[place]])
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
