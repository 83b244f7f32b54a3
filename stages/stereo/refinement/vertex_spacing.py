"""Vertices slid along their surface until its faces have no splinters."""

from __future__ import annotations

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface, joined
from stages.geometry.rays import summed_at_vertices, vertex_normals


def evenly_spaced(surface: Surface, steps: int) -> Surface:
    """Slide each vertex towards the middle of the faces around it, in its tangent plane.

    Meshes of marching cubes, as Poisson's, are full of splinters: faces much lower than their edges are long.
    The slightest difference of height between their corners turns them over. Borders stay where they are, or
    they would shrink.

    Parameters
    ----------
    surface : Surface
    steps : int
        How often.

    Returns
    -------
    Surface
        The same faces.

    Notes
    -----
    The tangential step of Botsch and Kobbelt's remeshing (2004), with the centroids of faces: that is two
    thirds of the way to the mean of the neighbours, weighed alike.
    """
    whole, number_in_whole = joined(surface)  # at seams, or they would be borders
    vertices, faces = whole.vertices.astype(np.float64), whole.faces
    free = ~_on_border(faces, len(vertices))
    counts = np.maximum(np.bincount(faces.ravel(), minlength=len(vertices)), 1)[:, None]
    for _ in range(steps):
        middles = summed_at_vertices(vertices[faces].mean(axis=1), faces, len(vertices)) / counts
        normals = vertex_normals(vertices, faces).astype(np.float64)
        way = middles - vertices
        way -= normals * np.einsum("vk,vk->v", normals, way)[:, None]
        vertices = np.where(free[:, None], vertices + way, vertices)
    return Surface(vertices[number_in_whole], surface.faces)


def _on_border(faces: np.ndarray, vertices: int) -> np.ndarray:
    """Tell the vertices, (V,), whose faces close no ring: edges opposite to them do not add up to none."""
    opposite = np.roll(faces, -1, axis=1).astype(np.int64) - np.roll(faces, -2, axis=1)
    return np.bincount(faces.ravel(), opposite.ravel(), minlength=vertices) != 0
