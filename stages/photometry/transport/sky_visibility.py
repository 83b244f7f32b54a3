"""Visibility of the sky from points, by rays in many directions."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from stages.photometry.transport.directional_transport import Sphere, offsets_in
from stages.photometry.transport.settings import VisibilitySettings

# Maps rays, as origins and unit directions, (r, 3) float32 each, to whether they are blocked, (r,) bool.
Blocked = Callable[[np.ndarray, np.ndarray], np.ndarray]


def visible_directions(
    positions: np.ndarray,
    normals: np.ndarray,
    blocked: Blocked,
    directions: np.ndarray,
    how: VisibilitySettings,
    sphere: Sphere | None = None,
    executor: Executor | None = None,
    after_each: Callable[[], None] = lambda: None,
) -> np.ndarray:
    """Compute the visibility of the sky from points in many directions.

    Parameters
    ----------
    positions : ndarray, shape (P, 3)
        Ray origins: slightly off the surface.
    normals : ndarray, shape (P, 3)
        Unit. Directions well behind the surface are not sampled, and count as blocked.
    blocked : callable
    directions : ndarray, shape (M, 3)
    how : VisibilitySettings
    sphere : Sphere or None
        Sphere of the light, in the frame of the positions; None: at infinity.
    executor : concurrent.futures.Executor or None
        Threads that each trace eight directions at a time; never changes the result.
    after_each : callable
        Called after every eight directions.

    Returns
    -------
    ndarray, shape (P, ⌈M/8⌉), uint8
        A bit per direction, the first in the highest bit.
    """
    origins, normals = np.asarray(positions, np.float32), np.asarray(normals, np.float32)
    offsets = None if sphere is None else offsets_in(sphere, positions)
    visible = np.zeros((len(origins), -(-len(directions) // 8)), np.uint8)

    def trace(byte: int) -> None:
        for bit, direction in enumerate(np.asarray(directions[8 * byte : 8 * byte + 8], np.float32)):
            towards = np.broadcast_to(direction, origins.shape) if offsets is None else direction - offsets
            facing = np.flatnonzero(np.einsum("pk,pk->p", normals, towards) > how.min_cosine)
            towards = towards[facing]
            if offsets is not None:
                towards /= np.linalg.norm(towards, axis=1, keepdims=True)
            free = ~blocked(origins[facing], towards)
            visible[facing[free], byte] |= np.uint8(128 >> bit)

    for _ in (map if executor is None else executor.map)(trace, range(visible.shape[1])):
        after_each()
    return visible


@dataclass(frozen=True, eq=False)
class VisibilityProbes:
    """Points whose visibility of the sky can be computed, with their occluders.

    Attributes
    ----------
    positions : ndarray, shape (P, 3)
        Slightly off the surface, relative to the origin.
    normals : ndarray, shape (P, 3)
        Unit, world axes.
    blocked : callable
        Takes rays relative to the origin.
    origin : ndarray, shape (3,)
        World.
    how : VisibilitySettings
    executor : concurrent.futures.Executor or None
    """

    positions: np.ndarray
    normals: np.ndarray
    blocked: Blocked
    origin: np.ndarray
    how: VisibilitySettings
    executor: Executor | None = None

    def see(
        self, directions: np.ndarray, sphere: Sphere | None, after_each: Callable[[], None] = lambda: None
    ) -> np.ndarray:
        """Compute the visibility of sky or sphere in directions, world axes; see `visible_directions`."""
        there = None
        if sphere is not None:
            there = Sphere(tuple(np.array(sphere.centre) - self.origin), sphere.radius)
        return visible_directions(
            self.positions,
            self.normals,
            self.blocked,
            directions,
            self.how,
            there,
            self.executor,
            after_each,
        )
