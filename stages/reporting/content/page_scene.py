"""Geometry for the page: a mesh and cameras in its scene, y up, in the mesh's own box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface
from stages.scene.cameras import Camera

POSITION_CODES = 65535  # positions in sixteen bits: a pixel of a screen is a hundred steps


@dataclass(frozen=True, eq=False)
class PageScene:
    """Axes, corner and unit of the page's scene, in which a mesh reaches from 0 to 1 along its longest side.

    Attributes
    ----------
    scene_from_world : ndarray, shape (3, 3)
        Rotation, y up.
    low : ndarray, shape (3,)
        The corner, in rotated axes, model units.
    size : float
        Of the longest side, model units.
    middle : ndarray, shape (3,)
        Of the box, in the scene.
    """

    scene_from_world: np.ndarray
    low: np.ndarray
    size: float
    middle: np.ndarray

    @classmethod
    def around(cls, vertices: np.ndarray, scene_from_world: np.ndarray) -> PageScene:
        """Fit the scene to vertices, (V, 3)."""
        rotated = vertices @ scene_from_world.T
        low, high = rotated.min(axis=0), rotated.max(axis=0)
        size = float((high - low).max()) or 1.0
        return cls(scene_from_world, low, size, (high - low) / 2 / size)

    def placed(self, points: np.ndarray) -> np.ndarray:
        """Bring points, (..., 3), of the world into the scene."""
        return (points @ self.scene_from_world.T - self.low) / self.size

    def mesh_as_bytes(self, surface: Surface, normals: np.ndarray, blocks: Sequence[bytes]) -> bytes:
        """Lay a mesh out: little-endian, one block after the other.

        Positions (V, 3) uint16; normals (V, 3) int8; what else the vertices have, `blocks`; padding to 4
        bytes; faces (F, 3) uint32.
        """
        codes = np.rint(self.placed(surface.vertices).clip(0, 1) * POSITION_CODES).astype("<u2")
        directions = np.rint(normals @ self.scene_from_world.T * 127).astype("<i1")
        whole = b"".join([codes.tobytes(), directions.tobytes(), *blocks])
        return whole + bytes(-len(whole) % 4) + surface.faces.astype("<u4").tobytes()

    def as_json(self, surface: Surface, cameras: list[Camera]) -> dict[str, Any]:
        """Describe the mesh's layout and where the cameras are."""
        return {
            "vertices": len(surface.vertices),
            "faces": len(surface.faces),
            "low": self.low.tolist(),
            "size": self.size,
            "middle": self.middle.tolist(),
            "cameras": [self._frustum(camera) for camera in cameras],
        }

    def _frustum(self, camera: Camera) -> dict[str, Any]:
        """Place a camera: its centre, and the directions through its image's corners, at z = 1 in it."""
        corners = np.array(
            [[0, 0, 1], [camera.width, 0, 1], [camera.width, camera.height, 1], [0, camera.height, 1]], float
        )
        rays = corners @ np.linalg.inv(camera.intrinsics).T @ camera.rotation @ self.scene_from_world.T
        return {"centre": self.placed(camera.centre_in_world).tolist(), "rays": rays.round(5).tolist()}
