"""Distances between a mesh and the sparse points."""

from __future__ import annotations

import numpy as np

from stages.scene.cameras import Camera, in_image, project


def gaps_at_points(camera: Camera, depth: np.ndarray, x_in_world: np.ndarray) -> np.ndarray:
    """Measure the gaps in depth between a mesh and the points that fall on it, (m,), model units.

    Parameters
    ----------
    camera : Camera
    depth : ndarray, shape (h, w)
        Of the mesh; 0 where the view sees none of it.
    x_in_world : ndarray, shape (n, 3)
        Points that the view has observed, so that nothing is in front of them. Those beside the mesh, as in
        the background of an object, say nothing.
    """
    xy, z = project(camera, x_in_world)
    inside = in_image(camera, xy, z)
    column, row = xy[inside].astype(np.int64).T
    there = depth[row, column]
    return np.abs(z[inside] - there)[there > 0]
