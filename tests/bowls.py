"""Cavities whose light is known by hand: spherical bowls and cones, open to the sky above."""

from __future__ import annotations

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface


def bowl(depth: float, rings: int = 30, around: int = 60) -> Surface:
    """The part of the unit sphere below ``z = 2 depth − 1``, its inside the front; `depth` of its area."""
    heights = np.linspace(-1, 2 * depth - 1, rings + 1)[1:]
    return _rings(np.sqrt(1 - heights**2), heights, around)


def cone(half_angle_deg: float, rings: int = 30, around: int = 60) -> Surface:
    """A cone of slant 1 about +z, its apex at the origin, its inside the front."""
    along = np.linspace(0, 1, rings + 1)[1:]
    angle = np.radians(half_angle_deg)
    return _rings(along * np.sin(angle), along * np.cos(angle), around, apex=0.0)


def _rings(radii: np.ndarray, heights: np.ndarray, around: int, apex: float = -1.0) -> Surface:
    """A fan from the lowest point to the first ring, then bands from ring to ring."""
    angles = 2 * np.pi * np.arange(around) / around
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rings = [np.column_stack([r * circle, np.full(around, h)]) for r, h in zip(radii, heights, strict=True)]
    vertices = np.concatenate([[[0.0, 0.0, apex]], *rings])
    here, there = np.arange(around), np.roll(np.arange(around), -1)
    faces = [np.stack([np.zeros(around, int), 1 + here, 1 + there], axis=1)]
    for ring in range(len(radii) - 1):
        low, high = 1 + ring * around, 1 + (ring + 1) * around
        faces.append(np.stack([low + here, high + here, high + there], axis=1))
        faces.append(np.stack([low + here, high + there, low + there], axis=1))
    return Surface(vertices, np.concatenate(faces).astype(np.int32))
