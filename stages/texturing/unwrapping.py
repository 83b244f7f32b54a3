"""A mesh within a budget of faces, and its charts, by xatlas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xatlas

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.decimation.proxy import roughly_decimated, welded
from stages.geometry.rays import face_normals, vertex_normals
from stages.texturing.settings import ChartSettings


@dataclass(frozen=True, eq=False)
class ChartedMesh:
    """A mesh whose every vertex has one place in the atlas; along chart borders they are doubled.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3), float64
        World axes.
    normals : ndarray, shape (V, 3), float64
        Unit, area-weighted means over faces, the same at doubled vertices.
    faces : ndarray, shape (F, 3), int32
    uv : ndarray, shape (V, 2), float64
        Of the atlas, in [0, 1]; v downwards, as rows of an image.
    original : ndarray, shape (V,), int64
        Equal for vertices that are one on the surface.
    """

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    original: np.ndarray


def within_budget(surface: Surface, how: ChartSettings) -> Surface:
    """Weld a mesh, drop faces without area, and decimate it if it has more faces than allowed."""
    whole = welded(surface)
    if len(whole.faces) > how.most_faces:
        whole = roughly_decimated(whole, how.most_faces, how.proxy)
    solid = np.linalg.norm(face_normals(whole.vertices, whole.faces), axis=1) > 0
    return Surface(whole.vertices, whole.faces[solid])


def unwrapped(surface: Surface, side_px: int, how: ChartSettings) -> ChartedMesh:
    """Unwrap a mesh into charts of one atlas.

    Parameters
    ----------
    surface : Surface
    side_px : int
        Side of the texture, texels: padding is in its units.
    how : ChartSettings
    """
    atlas = xatlas.Atlas()
    atlas.add_mesh(_at_size_of_faces(surface).astype(np.float32), surface.faces.astype(np.uint32))
    pack = xatlas.PackOptions()
    pack.resolution, pack.padding, pack.bilinear = side_px, how.padding_px, True
    atlas.generate(xatlas.ChartOptions(), pack)
    original, faces, uv = atlas[0]
    original = original.astype(np.int64)
    return ChartedMesh(
        surface.vertices[original],
        normals_of(surface)[original],
        faces.astype(np.int32),
        uv.astype(np.float64),
        original,
    )


def _at_size_of_faces(surface: Surface) -> np.ndarray:
    """Centre and scale the vertices so that a face has an area of 1 on average.

    xatlas gives no place in the atlas to faces smaller than 1e-7 and to edges shorter than 1e-4, whatever
    the unit: of an object of a tenth of a unit that was each sixth face.
    """
    area = np.linalg.norm(face_normals(surface.vertices, surface.faces), axis=1).mean() / 2
    return (surface.vertices - surface.vertices.mean(axis=0)) / np.sqrt(area)


def normals_of(surface: Surface) -> np.ndarray:
    """Compute unit normals of vertices, (V, 3); where those of the faces around cancel, one of theirs.

    Where no face around has area, any: z. Files and renderers take no normal without length.
    """
    normals = vertex_normals(surface.vertices - surface.vertices.mean(axis=0), surface.faces).astype(float)
    any_face = np.zeros_like(normals)
    any_face[surface.faces.ravel()] = np.repeat(face_normals(surface.vertices, surface.faces), 3, axis=0)
    normals = np.where(np.linalg.norm(normals, axis=1, keepdims=True) > 0.5, normals, any_face)
    normals[~normals.any(axis=1)] = 0, 0, 1
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
