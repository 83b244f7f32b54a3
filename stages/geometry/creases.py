"""Which corners of faces share a vertex, told from the shape: for meshes whose files do not say."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from stages.scene.meshes import Surface, joined


def shared_corners(surface: Surface, crease_deg: float) -> Surface:
    """Vertices that lie on one another become one, but not across a crease.

    STL, and OBJ and GLB with a texture, give every face corners of its own: the normals of their vertices
    are those of faces, and a sphere is a lantern. Joined without regard, a box would be a cushion.

    Parameters
    ----------
    surface : Surface
        One that no two vertices of lie on one another is returned as it is: its file says what is shared.
    crease_deg : float
        Faces that meet at more than this angle, in degrees between their normals, share no vertex there,
        unless faces around the vertex lead from one to the other by smaller angles. So do faces of
        opposite winding.

    Returns
    -------
    Surface
        Without the faces two of whose corners are one: they are without area.
    """
    whole, _ = joined(surface)
    if whole is surface:
        return surface
    faces = whole.faces[(whole.faces != np.roll(whole.faces, -1, axis=1)).all(axis=1)]
    one, two = _corners_across_smooth_edges(Surface(whole.vertices, faces), np.cos(np.deg2rad(crease_deg)))
    links = sp.coo_array((np.ones(len(one), bool), (one, two)), shape=(faces.size, faces.size))
    count, vertex_of_corner = connected_components(links, directed=False)
    vertices = np.empty((count, 3))
    vertices[vertex_of_corner] = whole.vertices[faces.ravel()]
    return Surface(vertices, vertex_of_corner.reshape(-1, 3).astype(np.int32))


def _corners_across_smooth_edges(surface: Surface, least_cosine: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of corners, 3 · face + k, that two faces have at the same end of an edge without a crease."""
    faces = surface.faces
    corners = np.arange(faces.size).reshape(-1, 3)
    forwards = faces < np.roll(faces, -1, axis=1)
    low = np.where(forwards, corners, np.roll(corners, -1, axis=1)).ravel()
    high = np.where(forwards, np.roll(corners, -1, axis=1), corners).ravel()
    edge = faces.ravel()[low] * np.int64(len(surface.vertices)) + faces.ravel()[high]
    order = np.argsort(edge, kind="stable")
    meet = edge[order][1:] == edge[order][:-1]
    one, two = order[:-1][meet], order[1:][meet]
    a, b, c = (surface.vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    smooth = (
        np.einsum("ek,ek->e", normals[one // 3], normals[two // 3])
        >= least_cosine * length[one // 3] * length[two // 3]
    )
    one, two = one[smooth], two[smooth]
    return np.concatenate([low[one], high[one]]), np.concatenate([low[two], high[two]])
