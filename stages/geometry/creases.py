"""Shared vertices from the shape of a mesh, for files that give every face its own."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from stages.formats.meshes.triangle_meshes import Surface, joined


def shared_corners(surface: Surface, crease_deg: float) -> Surface:
    """Join vertices that lie on one another, but not across a crease.

    STL, and OBJ and GLB with a texture, give every face corners of its own: the normals of their vertices
    are those of faces, and a sphere is a lantern. Joined without regard, a box would be a cushion.

    Parameters
    ----------
    surface : Surface
        What its faces share they go on sharing: who made it has said so.
    crease_deg : float
        Faces that meet at more than this angle, in degrees between their normals, come to share no vertex
        there, unless faces around the vertex lead from one to the other by smaller angles. Nor do faces of
        opposite winding.

    Returns
    -------
    Surface
        The same where no two vertices lie on one another; else without vertices that no face has, and
        without the faces two of whose corners are one: they are without area.
    """
    whole, _ = joined(surface)
    if whole is surface:
        return surface
    proper = (whole.faces != np.roll(whole.faces, -1, axis=1)).all(axis=1)
    faces = whole.faces[proper]
    across = _corners_across_smooth_edges(Surface(whole.vertices, faces), np.cos(np.deg2rad(crease_deg)))
    one, two = np.concatenate([across, _neighbours_alike(surface.faces[proper].ravel())], axis=1)
    correspondences = sp.coo_array((np.ones(len(one), bool), (one, two)), shape=(faces.size, faces.size))
    count, vertex_of_corner = connected_components(correspondences, directed=False)
    vertices = np.empty((count, 3))
    vertices[vertex_of_corner] = whole.vertices[faces.ravel()]
    return Surface(vertices, vertex_of_corner.reshape(-1, 3).astype(np.int32))


def _neighbours_alike(labels: np.ndarray) -> np.ndarray:
    """Pairs of indices, (2, n), consecutive among those with the same label."""
    order = np.argsort(labels, kind="stable")
    alike = labels[order][1:] == labels[order][:-1]
    return np.stack([order[:-1][alike], order[1:][alike]])


def _corners_across_smooth_edges(surface: Surface, least_cosine: float) -> np.ndarray:
    """Pairs of corners, 3 · face + k, (2, n): of two faces, at one end of an edge without a crease."""
    faces = surface.faces
    corners = np.arange(faces.size).reshape(-1, 3)
    forwards = faces < np.roll(faces, -1, axis=1)
    low = np.where(forwards, corners, np.roll(corners, -1, axis=1)).ravel()
    high = np.where(forwards, np.roll(corners, -1, axis=1), corners).ravel()
    edge = faces.ravel()[low] * np.int64(len(surface.vertices)) + faces.ravel()[high]
    one, two = _neighbours_alike(edge)
    a, b, c = (surface.vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    smooth = (
        np.einsum("ek,ek->e", normals[one // 3], normals[two // 3])
        >= least_cosine * length[one // 3] * length[two // 3]
    )
    one, two = one[smooth], two[smooth]
    return np.stack([np.concatenate([low[ends], high[ends]]) for ends in (one, two)])
