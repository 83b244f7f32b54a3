"""Visibility of suns from the surface points of pixels, by rays across their discs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from stages.photometry.sun.settings import SunSettings
from stages.photometry.transport.directional_transport import Sphere, axes_across, offsets_in

WHOLE = np.iinfo(np.uint8).max  # visibility of a sun that nothing hides
AT_ONCE = 200_000  # points: 30 MB

# Reads the surface points of a view's pixels: faces, (N_i,), and barycentric coordinates, (N_i, 2).
PointsOfView = Callable[[int], tuple[np.ndarray, np.ndarray]]


class LitSurface(Protocol):
    """A mesh whose points see suns; coordinates are relative to its origin."""

    origin: np.ndarray

    def points(self, faces: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Interpolate points slightly off the surface, (n, 3), float32."""

    def blocked(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Test whether rays, (r, 3) float32 each, meet the mesh: (r,), bool."""


@dataclass(frozen=True, eq=False)
class PixelRays:
    """Rays from the surface points of pixels, sorted by view, which the mesh may block.

    Attributes
    ----------
    prepared : callable
        Prepares the mesh when it is first needed: most scenes have no sun.
    points_of : callable
        Of a view, by its place among these.
    starts : ndarray, shape (n + 1,)
        First pixel of every view.
    how : SunSettings
    """

    prepared: Callable[[], LitSurface]
    points_of: PointsOfView
    starts: np.ndarray
    how: SunSettings

    def see(
        self,
        directions: np.ndarray,
        sphere: Sphere | None,
        normals: np.ndarray,
        pixels: np.ndarray | None = None,
        across: int | None = None,
    ) -> np.ndarray:
        """Find how much of suns in given directions pixels see.

        Parameters
        ----------
        directions : ndarray, shape (k, 3)
            Unit, world axes.
        sphere : Sphere or None
            On which the suns are; None: at infinity.
        normals : ndarray, shape (n, 3)
            Of the pixels that are looked from. A sun behind the surface is not seen.
        pixels : ndarray, shape (n,), or None
            Which they are, sorted; None: all.
        across : int or None
            Instead of the setting `rays_across`.

        Returns
        -------
        ndarray, shape (n, k), uint8
            In 255ths.
        """
        chosen = np.arange(len(normals)) if pixels is None else pixels
        seen = np.zeros((len(chosen), len(directions)), np.uint8)
        if not len(directions):
            return seen
        ends = np.searchsorted(chosen, self.starts)
        for view, (begin, end) in enumerate(zip(ends[:-1], ends[1:], strict=True)):
            if begin == end:
                continue
            faces, barycentric = self.points_of(view)
            for first in range(begin, end, AT_ONCE):
                rows = slice(first, min(first + AT_ONCE, end))
                there = chosen[rows] - self.starts[view]
                points = self._surface.points(faces[there], barycentric[there])
                seen[rows] = self._from(
                    points, normals[rows], directions, sphere, across or self.how.rays_across
                )
        return seen

    def _from(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        directions: np.ndarray,
        sphere: Sphere | None,
        across: int,
    ) -> np.ndarray:
        """Cast rays from points, (n, 3), across the disc of each of k suns: (n, k), uint8."""
        seen = np.zeros((len(points), len(directions)), np.uint8)
        offsets = offsets_in(sphere, points + self._surface.origin)
        for number, direction in enumerate(directions):
            towards = (direction - offsets).astype(np.float32)
            facing = np.flatnonzero(np.einsum("nk,nk->n", towards, normals) > 0)
            free = np.zeros(len(facing), np.float32)
            disc = _across(direction, np.deg2rad(self.how.radius_deg), across)
            for off in disc:
                rays = towards[facing] + off
                rays /= np.linalg.norm(rays, axis=1, keepdims=True)
                free += ~self._surface.blocked(points[facing], rays)
            seen[facing, number] = np.rint(WHOLE * free / len(disc))
        return seen

    @cached_property
    def _surface(self) -> LitSurface:
        return self.prepared()


def _across(direction: np.ndarray, radius: float, count: int) -> np.ndarray:
    """Compute offsets from a direction to a square grid on its disc, (count², 3), float32."""
    one, other = axes_across(direction[None])
    at = radius * ((2 * np.arange(count) + 1) / count - 1)
    x, y = (grid.reshape(-1, 1) for grid in np.meshgrid(at, at))
    return (x * one + y * other).astype(np.float32)
