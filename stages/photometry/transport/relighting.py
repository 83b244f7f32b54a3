"""Relighting of the views from their albedo."""

from __future__ import annotations

import numpy as np

from stages.photometry.transport.interreflection import bounced
from stages.photometry.transport.lit_scenes import LitScene
from stages.photometry.transport.pixel_transfer import WHITEST, Bounces, at_vertices, on_absolute_scale
from stages.solvers.kernels.sparse_rows import product


def relit(
    scene: LitScene, albedo: np.ndarray, light: np.ndarray, bounces: Bounces
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the pixels' radiance by Eq. 1 under another light.

    Parameters
    ----------
    scene : LitScene
        N pixels, M directions.
    albedo : ndarray, shape (N, 3)
        On any scale, common to the channels.
    light : ndarray, shape (M, 3)
        Radiance from the scene's directions.
    bounces : Bounces

    Returns
    -------
    tuple of two ndarray, shape (N, 3), float32
        ``ρ S`` with ρ on the absolute scale, and S.
    """
    absolute = on_absolute_scale(np.maximum(albedo, 0), bounces.brightest, bounces.quantile)
    shading, of_vertices = scene.pixels.shading(light), scene.vertices.shading(light)
    if bounces.count and len(absolute):
        blend, values = scene.pixels.blend, np.minimum(absolute, WHITEST)
        there = np.stack([at_vertices(blend, scene.nearest_shown, one) for one in values.T], axis=1)
        typical = np.median(values, axis=0).astype(np.float32)
        seen = scene.proxy.occlusion
        total = bounced(of_vertices, seen, there.astype(np.float32), typical, bounces.count)
        shading += product(blend, total - of_vertices)
    return (absolute * shading).astype(np.float32), shading
