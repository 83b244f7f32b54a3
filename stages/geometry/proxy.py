"""A smaller mesh in place of a large one, and how values on the small one reach the vertices of the large."""

from __future__ import annotations

import numpy as np
import open3d as o3d

from stages.geometry.occluders import scene_of
from stages.geometry.short_edges import with_short_edges
from stages.geometry.surface import decimated, mean_edge
from stages.scene.meshes import Surface

FACES_PER_VERTEX = 2  # of a closed mesh


def room_for(surface: Surface, most_vertices: int) -> int:
    """How many vertices it may have once its edges are short: half as many again if it is too large."""
    count = len(surface.vertices)
    return most_vertices if count <= most_vertices else count + count // 2


def proxy_of(surface: Surface, most_vertices: int, longest_edge: float = np.inf) -> Surface:
    """The surface itself, or a quadric decimation of it to about so many vertices.

    Vertices that lie on one another are one first, as in STL or at the seams of a texture: otherwise nothing
    could be decimated. Decimation leaves large faces where all is flat; they are cut until no edge is longer
    than `longest_edge`, unless there would be half as many vertices again.
    """
    places, number = np.unique(surface.vertices, axis=0, return_inverse=True)
    if len(places) < len(surface.vertices):
        faces = number.reshape(-1)[surface.faces].astype(np.int32)
        collapsed = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
        surface = Surface(places, faces[~collapsed])
    if len(surface.vertices) <= most_vertices:
        return surface
    small = decimated(surface, FACES_PER_VERTEX * most_vertices)
    return with_short_edges(small, longest_edge, most_vertices + most_vertices // 2).surface


def blend_of(
    surface: Surface, normals: np.ndarray, proxy: Surface, threads: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Every vertex of the surface as a blend of the corners of the proxy's nearest face.

    Parameters
    ----------
    surface : Surface
    normals : ndarray, shape (V, 3)
        Its vertices'. Of a thin sheet the nearest face may be that of the other side: there, the one
        nearest to a point a little above the vertex is taken.
    proxy : Surface
    threads : int
        0: all.

    Returns
    -------
    tuple of ndarray, shape (V, 3), int32, and ndarray, shape (V, 3), float32
        Vertices of the proxy and their weights, which sum to 1.
    """
    count = len(surface.vertices)
    if proxy is surface:
        own = np.repeat(np.arange(count, dtype=np.int32)[:, None], 3, axis=1)
        return own, np.tile(np.float32([1, 0, 0]), (count, 1))
    scene, origin = scene_of(proxy, threads)
    places = (surface.vertices - origin).astype(np.float32)
    faces, weights, facing = _nearest(scene, places, normals)
    if not facing.all():
        above = places[~facing] + mean_edge(proxy) * normals[~facing].astype(np.float32)
        faces[~facing], weights[~facing], _ = _nearest(scene, above, normals[~facing])
    return proxy.faces[faces].astype(np.int32), weights


def _nearest(
    scene: o3d.t.geometry.RaycastingScene, places: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nearest face, weights of its corners, and whether it looks the way of the normal."""
    nearest = scene.compute_closest_points(o3d.core.Tensor(places))
    u, v = nearest["primitive_uvs"].numpy().T
    weights = np.clip(np.stack([1 - u - v, u, v], axis=1), 0, 1)
    facing = np.einsum("vk,vk->v", nearest["primitive_normals"].numpy(), normals) >= 0
    return nearest["primitive_ids"].numpy().copy(), weights / weights.sum(axis=1, keepdims=True), facing
