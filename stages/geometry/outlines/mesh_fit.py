"""How a mesh fits what the photos show: distances to the sparse points, outlines before a background."""

from __future__ import annotations

import cv2
import numpy as np

from stages.geometry.outlines.border_distances import distances_from_border
from stages.scene.cameras import Camera, pixels_of


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
    _, pixel, z = pixels_of(camera, x_in_world)
    there = depth[pixel]
    return np.abs(z - there)[there > 0]


def beyond_outline(mask: np.ndarray, background: np.ndarray, reach_px: float) -> np.ndarray:
    """Select pixels of a mesh at which the view shows background, no farther from its outline than a reach.

    Parameters
    ----------
    mask : ndarray, shape (h, w), bool
        Pixels that see the mesh.
    background : ndarray, shape (h, w), bool
        Even background, as stereo tells it by the edges of the photo
        (`stages.stereo.depth.depth_edges.up_to_edges`).
    reach_px : float
        How far a mesh goes on beyond outlines, pixels.

    Returns
    -------
    ndarray, shape (h, w), bool

    Notes
    -----
    The border of the photo is no outline. A plain wall up to that border passes for background, too; within
    the mesh it stays. Pixels beside those that are beyond mix both sides, and go with them.
    """
    if not background.any():
        return np.zeros_like(mask)
    to_outline_px = distances_from_border(mask)
    beyond = mask & background & (to_outline_px <= reach_px)
    return mask & (cv2.dilate(beyond.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
