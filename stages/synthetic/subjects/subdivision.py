"""Split triangles until their edges are short, so that vertices can carry a texture of a given fineness."""

from __future__ import annotations

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface

# Faces a, b, c with midpoints d of ab, e of bc, f of ca; which edges are split, and into what.
TEMPLATES = {
    (0, 0, 0): ("abc",),
    (1, 0, 0): ("adc", "dbc"),
    (0, 1, 0): ("abe", "aec"),
    (0, 0, 1): ("abf", "fbc"),
    (1, 1, 0): ("dbe", "ade", "aec"),
    (0, 1, 1): ("fec", "abe", "aef"),
    (1, 0, 1): ("adf", "dbc", "dcf"),
    (1, 1, 1): ("adf", "dbe", "fec", "def"),
}


def subdivided(surface: Surface, longest: float) -> tuple[Surface, np.ndarray]:
    """Halve all edges longer than `longest`, again and again; the surface itself stays as it is.

    An edge is split in both of its faces, so that no crack opens.

    Returns
    -------
    surface : Surface
        The given vertices first, in their order.
    origin : ndarray, shape (V,), int64
        Of every vertex, a given vertex of the face it lies on.
    """
    vertices, faces = surface.vertices, surface.faces.astype(np.int64)
    origin = np.arange(len(vertices))
    while True:
        edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1)  # ab, bc, ca
        keys = edges[..., 0] * len(vertices) + edges[..., 1]
        unique, first, number = np.unique(keys, return_index=True, return_inverse=True)
        ends = edges.reshape(-1, 2)[first]
        split = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1) > longest
        if not split.any():
            return Surface(vertices, faces.astype(np.int32)), origin
        middle = np.full(len(unique), -1)
        middle[split] = len(vertices) + np.arange(np.count_nonzero(split))
        faces = _split_faces(faces, middle[number.reshape(faces.shape)])
        vertices = np.concatenate([vertices, vertices[ends[split]].mean(axis=1)])
        origin = np.concatenate([origin, origin[ends[split, 0]]])


def _split_faces(faces: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """Replace faces by their templates; `middles` (f, 3) holds −1 where an edge stays whole."""
    corners = np.concatenate([faces, middles], axis=1)
    pattern = (middles >= 0) @ [4, 2, 1]
    made = []
    for edges, triangles in TEMPLATES.items():
        chosen = corners[pattern == np.array(edges) @ [4, 2, 1]]
        made += [chosen[:, ["abcdef".index(letter) for letter in triangle]] for triangle in triangles]
    return np.concatenate(made)
