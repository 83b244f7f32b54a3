"""The order of a mesh's vertices and faces: what lies together in space lies together in memory."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from stages.formats.meshes.triangle_meshes import Surface


def ordered_by_neighbours(surface: Surface) -> Surface:
    """Number vertices so that neighbours have close numbers (Cuthill and McKee 1969), and sort faces by them.

    Passes over the vertices of a large mesh wait for memory: what they gather is then still in the cache.
    """
    vertices, faces = surface.vertices, surface.faces
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ends = np.concatenate([ends, ends[:, ::-1]])
    edges = coo_array((np.ones(len(ends), np.int8), ends.T), shape=(len(vertices), len(vertices))).tocsr()
    order = reverse_cuthill_mckee(edges, symmetric_mode=True)
    number = np.empty(len(order), np.int32)
    number[order] = np.arange(len(order))
    renumbered = number[faces]
    by_first = np.argsort(renumbered.min(axis=1), kind="stable")
    return Surface(vertices[order], renumbered[by_first])
