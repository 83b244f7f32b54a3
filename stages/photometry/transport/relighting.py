"""Relighting of the views, and of any point of the surface, from albedo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.transport.directional_transport import DirectionalTransport
from stages.photometry.transport.interreflection import bounced
from stages.photometry.transport.lit_scenes import LitScene
from stages.photometry.transport.pixel_transfer import (
    WHITEST,
    Bounces,
    at_vertices,
    to_absolute_scale,
)
from stages.solvers.kernels.sparse_rows import product


@dataclass(frozen=True, eq=False)
class SurfaceLight:
    """What lights a surface of P vertices, from which any of its points is relit.

    Attributes
    ----------
    sky : ndarray, shape (M, 3)
        Radiance from the directions of the transport.
    indirect : ndarray, shape (P, 3), float32
        Shading of the vertices by the surface itself.
    to_absolute : float
        By which albedo is multiplied to be on the absolute scale.
    """

    sky: np.ndarray
    indirect: np.ndarray
    to_absolute: float


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
    return relit_points(scene.pixels, albedo, light_at(scene, albedo, light, bounces))


def light_at(scene: LitScene, albedo: np.ndarray, light: np.ndarray, bounces: Bounces) -> SurfaceLight:
    """Compute what lights a surface: the sky, and its own interreflection; parameters as for `relit`."""
    albedo = np.maximum(albedo, 0)
    factor = to_absolute_scale(albedo, bounces.brightest, bounces.quantile)
    of_vertices = scene.vertices.shading(light)
    if not bounces.count or not len(albedo):
        return SurfaceLight(light, np.zeros_like(of_vertices), factor)
    blend, values = scene.pixels.blend, np.minimum(albedo * factor, WHITEST)
    there = np.stack([at_vertices(blend, scene.nearest_shown, one) for one in values.T], axis=1)
    typical = np.median(values, axis=0).astype(np.float32)
    total = bounced(of_vertices, scene.proxy.occlusion, there.astype(np.float32), typical, bounces.count)
    return SurfaceLight(light, total - of_vertices, factor)


def relit_points(
    points: DirectionalTransport, albedo: np.ndarray, lit_by: SurfaceLight
) -> tuple[np.ndarray, np.ndarray]:
    """Compute radiance and shading, (n, 3) float32 each, of points of a surface with albedo (n, 3)."""
    shading = points.shading(lit_by.sky) + product(points.blend, lit_by.indirect)
    return (np.maximum(albedo, 0) * lit_by.to_absolute * shading).astype(np.float32), shading
