"""A smaller mesh in place of a large one, and how values on the small one reach the vertices of the large."""

from __future__ import annotations

import numpy as np
import open3d as o3d

from stages.geometry.surface import decimated
from stages.scene.meshes import Surface

FACES_PER_VERTEX = 2  # of a closed mesh


def proxy_of(surface: Surface, most_vertices: int) -> Surface:
    """The surface itself, or a quadric decimation of it to about so many vertices."""
    if len(surface.vertices) <= most_vertices:
        return surface
    return decimated(surface, FACES_PER_VERTEX * most_vertices)


def blend_of(surface: Surface, proxy: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Every vertex of the surface as a blend of the corners of the proxy's nearest face.

    Returns
    -------
    tuple of ndarray, shape (V, 3), int32, and ndarray, shape (V, 3), float32
        Vertices of the proxy and their weights, which sum to 1.
    """
    count = len(surface.vertices)
    if proxy is surface:
        own = np.repeat(np.arange(count, dtype=np.int32)[:, None], 3, axis=1)
        return own, np.tile(np.float32([1, 0, 0]), (count, 1))
    origin = proxy.vertices.mean(axis=0)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor((proxy.vertices - origin).astype(np.float32)),
        o3d.core.Tensor(proxy.faces.astype(np.uint32)),
    )
    nearest = scene.compute_closest_points(o3d.core.Tensor((surface.vertices - origin).astype(np.float32)))
    u, v = nearest["primitive_uvs"].numpy().T
    weights = np.clip(np.stack([1 - u - v, u, v], axis=1), 0, 1)
    corners = proxy.faces[nearest["primitive_ids"].numpy()].astype(np.int32)
    return corners, (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)
