"""The door for meshes: what people bring, in five formats, comes in whole or not at all."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh

from pipeline import UserError
from stages.scene.meshes import Surface, from_polygons
from stages.scene.ply import read_ply
from stages.scene.polygon_texts import read_obj, read_off
from stages.scene.polygons import Polygons
from stages.scene.promised_triangles import promised_triangles

# Each holds the whole mesh in one file; GLTF keeps its vertices in another, which nobody would digest.
READERS = {
    ".ply": lambda path: read_ply(path).polygons(),
    ".obj": read_obj,
    ".off": read_off,
    ".stl": lambda path: _triangles_of_library(path),
    ".glb": lambda path: _triangles_of_library(path),
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


def _triangles_of_library(path: Path) -> Polygons:
    """STL and GLB, all objects where their scene places them, compared with what the file says of itself."""
    promised = promised_triangles(path)
    try:
        scene = trimesh.load_scene(
            BytesIO(path.read_bytes()), file_type=path.suffix[1:].lower(), process=False, skip_materials=True
        )
        mesh = scene.to_mesh()
        vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    except Exception as error:  # the library raises whatever its parsers meet
        reason = " ".join(str(error).split())[:200]
        raise UserError(f"{path} cannot be read ({reason}); export it again, or as PLY.") from error
    if len(faces) != promised:
        raise UserError(
            f"{path} says that it holds {promised} triangles, and {len(faces)} could be read: it is damaged, "
            "or packed in a way that is not known here. Export it again, or as PLY."
        )
    return Polygons(vertices, np.full(len(faces), 3, np.int64), faces.reshape(-1))
