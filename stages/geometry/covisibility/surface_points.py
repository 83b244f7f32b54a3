"""Covisibility: how well each view sees the surface that other views show, at a sample of its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.geometry.covisibility.correspondences import pixels_showing
from stages.scene.cameras import Camera, back_project, footprint, project


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points of the surface that one view shows, or several.

    Attributes
    ----------
    points, normals : ndarray, shape (n, 3)
        World axes; points in model units.
    footprints : ndarray, shape (n,)
        z/f in the view that shows them, model units.
    """

    points: np.ndarray
    normals: np.ndarray
    footprints: np.ndarray

    @classmethod
    def sampled(
        cls, camera: Camera, depth: np.ndarray, normals: np.ndarray, mask: np.ndarray, count: int
    ) -> SurfacePoints:
        """Take at most `count` pixels of a view, evenly spaced in row order."""
        usable = np.flatnonzero(mask & (depth > 0))
        chosen = usable[np.linspace(0, len(usable) - 1, min(count, len(usable))).astype(np.int64)]
        sizes = np.asarray(footprint(camera, depth.reshape(-1)[chosen]), np.float64)
        points = back_project(camera, depth).reshape(-1, 3)[chosen]
        return cls(points, normals.reshape(-1, 3)[chosen].astype(np.float64), sizes)

    @classmethod
    def together(cls, several: list[SurfacePoints]) -> SurfacePoints:
        """Join the points of several views."""
        return cls(*(np.concatenate([getattr(one, name) for one in several]) for name in cls.__annotations__))

    def sharpness_in(
        self, camera: Camera, depth: np.ndarray, mask: np.ndarray, epsilon: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Measure how sharply a view shows those of the points that it sees.

        Parameters
        ----------
        camera : Camera
        depth, mask : ndarray, shape (height, width)
        epsilon : float
            Of Eq. 8, in pixel footprints.

        Returns
        -------
        seen : ndarray, shape (k,), int64
            Indices of the points that the view sees from the front.
        sharpness : ndarray, shape (k,), float64
            Pixels per length of surface in its most foreshortened direction, cos θ f/z, 1/model units.
        """
        shown = pixels_showing(self.points, self.footprints, camera, depth, mask, epsilon) >= 0
        way = camera.centre_in_world - self.points[shown]
        cosine = np.einsum("nk,nk->n", way, self.normals[shown]) / np.linalg.norm(way, axis=1)
        _, z = project(camera, self.points[shown])
        sharpness = cosine / footprint(camera, z)
        front = cosine > 0
        return np.flatnonzero(shown)[front], sharpness[front]
