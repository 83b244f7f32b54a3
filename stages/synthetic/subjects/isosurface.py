"""Marching cubes in a narrow band: a closed triangle mesh of a signed distance, at any resolution."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from skimage.measure import marching_cubes

from stages.formats.meshes.triangle_meshes import Surface

BLOCK = 8  # grid cells per side of the blocks that are evaluated or skipped together


def closed_surface(
    distance: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray, spacing: float
) -> Surface:
    """Mesh the zero level of a signed distance that is positive on the walls of a box.

    Only blocks that the surface may cross are evaluated, so that the cost grows with the surface's area.

    Parameters
    ----------
    distance : callable
        (n, 3) float32 points to (n,) float32 distances, with a slope of at most 1.5.
    low, high : ndarray, shape (3,)
        The box, model units.
    spacing : float
        Side of the grid cells, model units.

    Returns
    -------
    Surface
        The largest connected piece, right hand outwards, vertices rounded to float32.
    """
    blocks = np.ceil((np.asarray(high) - low) / (spacing * BLOCK)).astype(int)
    values = _band_values(distance, np.asarray(low, float), blocks, spacing)
    vertices, faces, _, _ = marching_cubes(values, level=0.0, gradient_direction="descent")
    return _largest_component((vertices * spacing + low).astype(np.float32).astype(float), faces)


def _largest_component(vertices: np.ndarray, faces: np.ndarray) -> Surface:
    """Drop the crumbs that a coarse grid leaves of thin features."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    correspondences = coo_matrix((np.ones(len(start), bool), (start, end)), shape=(len(vertices),) * 2)
    _, component = connected_components(correspondences, directed=False)
    kept = component == np.bincount(component).argmax()
    index = np.cumsum(kept) - 1
    return Surface(vertices[kept], index[faces[kept[faces[:, 0]]]].astype(np.int32))


def _band_values(
    distance: Callable[[np.ndarray], np.ndarray], low: np.ndarray, blocks: np.ndarray, spacing: float
) -> np.ndarray:
    """Distances on the whole grid: exact in blocks near the surface, the block centre's value elsewhere."""
    side = spacing * BLOCK
    corners = np.stack(np.meshgrid(*(np.arange(n) for n in blocks), indexing="ij"), axis=-1).reshape(-1, 3)
    at_centre = distance((low + (corners + 0.5) * side).astype(np.float32))
    values = np.repeat(
        np.repeat(np.repeat(at_centre.reshape(blocks), BLOCK, axis=0), BLOCK, axis=1), BLOCK, axis=2
    )
    inner = np.stack(np.meshgrid(*(np.arange(BLOCK),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    reach = 1.5 * side * np.sqrt(3) / 2 + 2 * spacing
    near = corners[np.abs(at_centre) < reach] * BLOCK
    for batch in np.array_split(near, max(1, len(near) // 64)):
        cells = batch[:, None, :] + inner
        points = (low + cells * spacing).astype(np.float32).reshape(-1, 3)
        values[tuple(cells.reshape(-1, 3).T)] = distance(points)
    return values
