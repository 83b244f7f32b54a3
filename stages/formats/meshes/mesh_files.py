"""Mesh files of users, in five formats, read whole or refused."""

from __future__ import annotations

from pathlib import Path

from pipeline import UserError
from stages.formats.meshes.glb import read_glb
from stages.formats.meshes.ply import read_ply
from stages.formats.meshes.polygon_texts import read_obj, read_off
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
