"""Normals of sparse points, estimated from their neighbours."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from stages.scene.cameras import Camera
from stages.stereo.view_selection import SparsePoints


def oriented_normals(cameras: list[Camera], points: SparsePoints, neighbours: int) -> np.ndarray:
    """Estimate unit normals of sparse points, (n, 3), float32, world axes, towards the observing cameras.

    The direction of least spread of the `neighbours` nearest points; turned to the mean direction of the
    cameras that observe the point.

    Parameters
    ----------
    cameras : list of Camera
        One per row of ``points.seen``.
    points : SparsePoints
        At least three.
    neighbours : int
    """
    x_in_world = points.x_in_world
    _, nearest = cKDTree(x_in_world).query(x_in_world, k=min(neighbours, len(x_in_world)))
    spread = x_in_world[nearest] - x_in_world[nearest].mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))
    normals = axes[:, :, 0]
    centres = np.stack([camera.centre_in_world for camera in cameras])
    seen = points.seen.T.astype(float)
    towards = seen @ centres / np.maximum(seen.sum(axis=1, keepdims=True), 1) - x_in_world
    flip = np.sum(normals * towards, axis=1, keepdims=True) < 0
    return np.where(flip, -normals, normals).astype(np.float32)
