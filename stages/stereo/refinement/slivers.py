"""Slivers of a mesh, and their vertices slid along the surface until there are hardly any."""

from __future__ import annotations

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface, joined
from stages.geometry.rays import face_normals, summed_at_vertices, vertex_normals
from stages.stereo.refinement.settings import SliverSettings


def without_slivers(surface: Surface, settings: SliverSettings) -> Surface:
    """Slide the vertices of slivers towards the middle of the faces around them, in their tangent planes.

    Meshes of marching cubes, as Poisson's, are full of slivers: faces much lower than their edges are long.
    The slightest difference of height between their corners turns them over. Borders stay where they are, or
    they would shrink.

    Parameters
    ----------
    surface : Surface
    settings : SliverSettings

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
    vertices, faces = whole.vertices, whole.faces
    border = _on_border(faces, len(vertices))
    counts = np.maximum(np.bincount(faces.ravel(), minlength=len(vertices)), 1)[:, None]
    for _ in range(settings.steps):
        slides = ~border & _of_slivers(vertices, faces, settings.altitude)
        if not slides.any():
            break
        middles = summed_at_vertices(vertices[faces].mean(axis=1), faces, len(vertices)) / counts
        normals = vertex_normals(vertices, faces).astype(np.float64)
        way = middles - vertices
        way -= normals * np.einsum("vk,vk->v", normals, way)[:, None]
        vertices = np.where(slides[:, None], vertices + way, vertices)
    return Surface(vertices[number_in_whole], surface.faces)


def _of_slivers(vertices: np.ndarray, faces: np.ndarray, altitude: float) -> np.ndarray:
    """Tell the vertices, (V,), of faces lower than a share of their longest edge."""
    edges = np.diff(vertices[faces[:, [0, 1, 2, 0]]], axis=1)
    longest = np.einsum("fek,fek->fe", edges, edges).max(axis=1)
    double_areas = np.linalg.norm(face_normals(vertices, faces), axis=1)
    found = np.zeros(len(vertices), bool)
    found[faces[double_areas < altitude * longest]] = True
    return found


def _on_border(faces: np.ndarray, vertices: int) -> np.ndarray:
    """Tell the vertices, (V,), whose faces close no ring: around a closed one, their differences cancel."""
    opposite = np.roll(faces, -1, axis=1).astype(np.int64) - np.roll(faces, -2, axis=1)
    return np.bincount(faces.ravel(), opposite.ravel(), minlength=vertices) != 0
