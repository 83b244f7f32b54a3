"""Interpolation of values at the proxy's vertices to pixels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from stages.formats.artefacts.transfer_file import StoredTransfer
from stages.formats.artefacts.view_files import Each
from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.short_edges import ShortEdged, with_short_edges

SurfacePoints = tuple[Sequence[np.ndarray], Sequence[np.ndarray]]  # faces, barycentric; view by view


def pixels_on_proxy(stored: StoredTransfer, mesh: Surface, points: SurfacePoints) -> sp.csr_array:
    """Interpolate the proxy's vertices at every pixel's point of the mesh: weights, (N, P)."""
    return pixels_on_proxy_of(with_short_edges(mesh, float(stored.longest_edge)), stored, points)


def pixels_on_proxy_of(
    short: ShortEdged, stored: StoredTransfer, points: SurfacePoints, each: Each = map
) -> sp.csr_array:
    """Interpolate likewise; the mesh already has edges no longer than `stored.longest_edge`."""
    carried, faces = short.carried(*points), short.surface.faces
    return blend_of_pixels(*carried, faces, stored.corners, stored.weights, len(stored.blocked), each)


def blend_of_pixels(
    triangles: Sequence[np.ndarray],
    barycentric: Sequence[np.ndarray],
    faces: np.ndarray,
    corners: np.ndarray,
    weights: np.ndarray,
    vertex_count: int,
    each: Each = map,
) -> sp.csr_array:
    """Build the matrix that interpolates a proxy's vertices at every pixel.

    Parameters
    ----------
    triangles : sequence of ndarray, shape (N_i,)
        Face behind every masked pixel, view by view.
    barycentric : sequence of ndarray, shape (N_i, 2)
        (u, v): the point is (1 − u − v) a + u b + v c.
    faces : ndarray, shape (F, 3)
    corners, weights : ndarray, shape (V, 3)
        Every vertex that faces have as a blend of the proxy's.
    vertex_count : int
        P.
    each : callable
        Maps a function over the views: `map`, or that of an executor.

    Returns
    -------
    csr_array, shape (N, P), float32
    """
    to_proxy = blend_matrix(corners, weights, vertex_count)

    def blend(view: int) -> sp.csr_array:
        uv = barycentric[view]
        shares = np.column_stack([1 - uv.sum(axis=1), uv]).astype(np.float32)
        return blend_matrix(faces[triangles[view]], shares, len(corners)) @ to_proxy

    return sp.csr_array(sp.vstack(list(each(blend, range(len(triangles)))), format="csr"))


def blend_matrix(corners: np.ndarray, weights: np.ndarray, vertex_count: int) -> sp.csr_array:
    """Arrange three vertices, (N, 3), and their weights for every point as a matrix, (N, vertices).

    Weights of 0 are left out.
    """
    kept = weights.ravel() != 0
    ends = np.concatenate([[0], np.cumsum(kept)])[::3]
    parts = weights.ravel()[kept], corners.ravel()[kept].astype(np.int32), ends.astype(np.int32)
    return sp.csr_array(parts, shape=(len(corners), vertex_count))
