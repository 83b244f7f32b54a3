"""Tangents of a charted mesh, and normals in their space, as glTF has them."""

from __future__ import annotations

import numpy as np

from stages.geometry.rays import summed_at_vertices
from stages.texturing.texels import Texels
from stages.texturing.unwrapping import ChartedMesh

TINY = 1e-12
TEXELS_AT_ONCE = 2**18  # of which normals are coded: bounds the memory


def tangents_of(mesh: ChartedMesh) -> np.ndarray:
    """Compute tangents, (V, 4): unit, along u; and the sign of ``normal × tangent`` that points against v.

    Means over the faces around a vertex, weighted by their area in the atlas, orthogonal to the normal.
    """
    first, second, third = (mesh.faces[:, k] for k in range(3))
    one, other = mesh.vertices[second] - mesh.vertices[first], mesh.vertices[third] - mesh.vertices[first]
    (u1, v1), (u2, v2) = (mesh.uv[second] - mesh.uv[first]).T, (mesh.uv[third] - mesh.uv[first]).T
    sign = np.sign(u1 * v2 - u2 * v1)[:, None]  # over the determinant: weighted by the area in the atlas
    along_u, along_v = (
        summed_at_vertices(sign * of_faces, mesh.faces, len(mesh.vertices))
        for of_faces in (v2[:, None] * one - v1[:, None] * other, u1[:, None] * other - u2[:, None] * one)
    )
    straight = along_u - (along_u * mesh.normals).sum(axis=1, keepdims=True) * mesh.normals
    lost = np.linalg.norm(straight, axis=1) < TINY
    straight[lost] = np.cross(mesh.normals[lost], _least_axis(mesh.normals[lost]))
    tangent = _unit(straight)
    upwards = -(np.cross(mesh.normals, tangent) * along_v).sum(axis=1)
    return np.column_stack([tangent, np.where(upwards < 0, -1.0, 1.0)])


def tangent_space(texels: Texels, mesh: ChartedMesh, tangents: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Express normals of texels by tangent, bitangent and normal of the mesh, (T, 3), unit, float32.

    Parameters
    ----------
    texels : Texels
    mesh : ChartedMesh
    tangents : ndarray, shape (V, 4)
        Those of `tangents_of`.
    normals : ndarray, shape (T, 3)
        World axes, of any length; zeros where unknown: there, the mesh's own.

    Notes
    -----
    x is along u, y against v (upwards in the image), z outwards. The axes are interpolated from the vertices
    and normalised, as renderers do.
    """
    found = np.empty(normals.shape, np.float32)
    for first in range(0, len(texels), TEXELS_AT_ONCE):
        part = slice(first, first + TEXELS_AT_ONCE)
        found[part] = _tangent_space(texels.at(part), mesh, tangents, normals[part])
    return found


def coded(directions: np.ndarray) -> np.ndarray:
    """Code unit vectors, (T, 3), as a normal map does, uint8: −1 to 1 is 0 to 255."""
    return np.rint(127.5 * (directions + 1)).astype(np.uint8)


def _tangent_space(
    texels: Texels, mesh: ChartedMesh, tangents: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    normal = _unit(texels.interpolated(mesh, mesh.normals))
    tangent = _unit(texels.interpolated(mesh, tangents[:, :3]))
    sign = tangents[mesh.faces[texels.face, 0], 3:].astype(np.float32)
    bitangent = sign * np.cross(normal, tangent)
    known = (normals**2).sum(axis=1, keepdims=True) > TINY
    shown = np.where(known, _unit(normals), normal)
    parts = [(shown * axis).sum(axis=1) for axis in (tangent, bitangent, normal)]
    return _unit(np.stack([*parts[:2], np.maximum(parts[2], 0)], axis=1)).astype(np.float32)


def _least_axis(normals: np.ndarray) -> np.ndarray:
    """Choose the axis most nearly perpendicular to each normal, (n, 3)."""
    return np.eye(3)[np.abs(normals).argmin(axis=1)]


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), TINY)
