"""UV maps of PLY files, whose properties have several names: of vertices, or of the corners of faces."""

from __future__ import annotations

from pathlib import Path, PurePath

import numpy as np

from pipeline import UserError
from stages.formats.meshes.ply import Ply, read_ply
from stages.formats.meshes.polygons import NO_UV, Polygons, UVMap, distinct, material_numbers

OF_VERTICES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
OF_CORNERS, OF_CORNERS_SIZES, TEXTURE_NUMBER = "texcoord", "texcoord sizes", "texnumber"


def read_ply_with_uv(path: Path) -> tuple[Polygons, UVMap]:
    """Read the faces of a PLY and their texture coordinates, those of corners before those of vertices.

    Raises
    ------
    UserError
        As `read_ply`; or a face has texture coordinates for some of its corners only.
    """
    file = read_ply(path)
    polygons = file.polygons()
    if OF_CORNERS_SIZES in file.face and file.face[OF_CORNERS_SIZES].any():
        uv, corners = _of_corners(path, file)
    else:
        uv, corners = _of_vertices(file)
    material, names = material_numbers(_textures_of_faces(file))
    return polygons, UVMap(uv, corners, material, names, v_upwards=True)


def _of_corners(path: Path, file: Ply) -> tuple[np.ndarray, np.ndarray]:
    numbers = np.asarray(file.face[OF_CORNERS_SIZES], np.int64)
    wrong = (numbers != 0) & (numbers != 2 * file.sizes)
    if wrong.any():
        first = int(wrong.argmax())
        raise UserError(
            f"{path} has {numbers[first]} texture coordinates on face number {first}; expected two for each "
            f"of its {file.sizes[first]} corners. Export the mesh again."
        )
    uv = np.asarray(file.face[OF_CORNERS], np.float64).reshape(-1, 2)
    has = np.repeat(numbers > 0, file.sizes)
    corners = np.full(len(file.corners), NO_UV, np.int64)
    corners[has] = np.arange(int(has.sum()))
    return uv, corners


def _of_vertices(file: Ply) -> tuple[np.ndarray, np.ndarray]:
    for names in OF_VERTICES:
        uv = file.columns(*names)
        if uv is not None:
            return uv, file.corners
    return np.zeros((0, 2)), np.full(len(file.corners), NO_UV, np.int64)


def _textures_of_faces(file: Ply) -> list[str]:
    """Name the texture of each face, by its number among the file's; by that number where it has no name."""
    if TEXTURE_NUMBER not in file.face:
        name = PurePath(file.textures[0]).stem if len(file.textures) == 1 else ""
        return [name] * len(file.sizes)
    stems = dict(enumerate(distinct([PurePath(name).stem for name in file.textures])))
    return [
        stems.get(number, f"texture_{number}") for number in np.asarray(file.face[TEXTURE_NUMBER]).tolist()
    ]
