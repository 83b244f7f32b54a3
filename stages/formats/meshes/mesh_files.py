"""Mesh files of users, in five formats, read whole or refused."""

from __future__ import annotations

from pathlib import Path

from pipeline import UserError
from stages.formats.meshes.glb import read_glb, read_glb_with_uv
from stages.formats.meshes.ply import read_ply
from stages.formats.meshes.ply_uv import read_ply_with_uv
from stages.formats.meshes.polygon_texts import read_obj, read_obj_with_uv, read_off
from stages.formats.meshes.polygons import Polygons, UVMap, checked_uv_map
from stages.formats.meshes.stl import read_stl
from stages.formats.meshes.triangle_meshes import Surface, from_polygons

# Each holds the whole mesh in one file; GLTF keeps its vertices in another, which no digest would cover.
READERS = {
    ".ply": lambda path: read_ply(path).polygons(),
    ".obj": read_obj,
    ".off": read_off,
    ".stl": read_stl,
    ".glb": read_glb,
}
READERS_WITH_UV = {".ply": read_ply_with_uv, ".obj": read_obj_with_uv, ".glb": read_glb_with_uv}


def read_mesh_file(path: Path) -> Surface:
    """Read PLY, OBJ, STL, OFF or GLB; faces of more than three corners are divided into triangles.

    Raises
    ------
    UserError
        It is of another kind, cannot be read, was cut off, has no faces, or holds a vertex that is not finite
        or a face whose vertex is missing.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise UserError(f"{path} is of an unknown kind; expected PLY, OBJ, STL, OFF or GLB: convert it.")
    return from_polygons(path, reader(path))


def read_uv_map(path: Path) -> tuple[Polygons, UVMap] | None:
    """Read the faces of a mesh file and their texture coordinates; None for a file without any.

    The faces are those of `read_mesh_file`, in their order, before they are divided into triangles. Those of
    an OBJ share its positions, whatever parts them there.

    Raises
    ------
    UserError
        It cannot be read, or its texture coordinates are not whole: see `checked_uv_map`.
    """
    reader = READERS_WITH_UV.get(path.suffix.lower())
    if reader is None:
        return None
    polygons, found = reader(path)
    checked = checked_uv_map(path, polygons, found)
    return None if checked is None else (polygons, checked)
