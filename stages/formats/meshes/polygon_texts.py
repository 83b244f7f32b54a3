"""OBJ and OFF, read with faces of any size: open3d drops those that are no triangles."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline import UserError
from stages.formats.meshes.polygons import FEWEST_CORNERS, Polygons, UVMap, material_numbers

LARGEST_INDEX = 2**62
BOM = b"\xef\xbb\xbf"
FACES = (b"f", b"fo")  # the second is the first's older name
CURVES = (b"surf", b"curv", b"curv2")
CONTINUED = (b"v", b"vt", b"vn", b"l", b"p", *FACES)
OFF_HEAD = re.compile(rb"(?:(?:ST)?C?N?OFF)? ?(\d+ \d+.*)?", re.ASCII)


@dataclass
class _Obj:
    """What the lines of an OBJ say; of each corner the numbers of its ``v``, ``vt`` and ``vn``, from 0."""

    positions: list[list[float]] = field(default_factory=list)
    uv: list[list[float]] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)
    corners: list[tuple[int, ...]] = field(default_factory=list)
    materials: list[str] = field(default_factory=list)

    @property
    def vertices(self) -> np.ndarray:
        return np.array(self.positions, np.float64).reshape(-1, 3)

    @property
    def triples(self) -> np.ndarray:
        return np.array(self.corners, np.int64).reshape(-1, 3)


def read_obj(path: Path) -> Polygons:
    """Read the faces of all objects and groups of a Wavefront OBJ.

    Corners are one vertex where all three of their numbers agree (``v``, ``vt`` and ``vn``): a file without
    normals may say by the seams of its texture alone where surface is not smooth.

    Raises
    ------
    UserError
        A line cannot be read, or a face has fewer than three corners or one that is not there.
    """
    found = _parsed_obj(path, with_uv=False)
    vertices, triples, counts = found.vertices, found.triples, np.array(found.sizes, np.int64)
    if not len(triples) or (triples[:, 1:] < 0).all() or triples[:, 0].max() >= len(vertices):
        return Polygons(vertices, counts, triples[:, 0])
    parted, vertex_of_corner = np.unique(triples, axis=0, return_inverse=True)
    return Polygons(vertices[parted[:, 0]], counts, vertex_of_corner.reshape(-1))


def read_obj_with_uv(path: Path) -> tuple[Polygons, UVMap]:
    """Read the faces of a Wavefront OBJ over its positions alone, ``v``; ``vt`` and ``usemtl`` beside them.

    Raises
    ------
    UserError
        As `read_obj`; or texture coordinates cannot be read.
    """
    found = _parsed_obj(path, with_uv=True)
    material, names = material_numbers(found.materials)
    uv_map = UVMap(
        np.array(found.uv, np.float64).reshape(-1, 2), found.triples[:, 1], material, names, v_upwards=True
    )
    return Polygons(found.vertices, np.array(found.sizes, np.int64), found.triples[:, 0]), uv_map


def _parsed_obj(path: Path, with_uv: bool) -> _Obj:
    found, material = _Obj(), ""
    seen = {b"v": 0, b"vt": 0, b"vn": 0}
    for number, words in _lines_of(path):
        try:
            if words[0] in seen:
                seen[words[0]] += 1
            if words[0] == b"v":
                found.positions.append(_position(words))
            elif words[0] in CURVES:
                raise ValueError("curved surface is not read")
            elif words[0] in FACES:
                found.sizes.append(_size(words))
                found.corners += [_corner(word, tuple(seen.values())) for word in words[1:]]
                found.materials.append(material)
            elif with_uv and words[0] == b"vt":
                found.uv.append(_texture_coordinate(words))
            elif words[0] == b"usemtl":
                material = b" ".join(words[1:]).decode("utf-8", "backslashreplace")
        except ValueError as error:
            raise UserError(
                f"{path} cannot be read at line {number}, {b' '.join(words)[:60]!r} ({error}); it was cut "
                "off or damaged. Export the mesh again."
            ) from error
    return found


def read_off(path: Path) -> Polygons:
    """Read an OFF in text, with or without colours, normals or texture coordinates.

    Raises
    ------
    UserError
        It is no such file, or holds fewer or more lines than it promises.
    """
    lines = [words for _, words in _lines_of(path)]
    try:
        head = OFF_HEAD.fullmatch(b" ".join(lines[0]))
        if head is None:
            raise ValueError("it does not begin with OFF, or is of another dimension, or binary")
        rest = [head[1].split(), *lines[1:]] if head[1] else lines[1:]
        vertex_count, face_count = int(rest[0][0]), int(rest[0][1])
        if min(vertex_count, face_count) < 0 or len(rest) - 1 != vertex_count + face_count:
            raise ValueError(
                f"it promises {vertex_count} vertices and {face_count} faces and has {len(rest) - 1} lines"
            )
        vertices = np.array([_position([b"v", *words]) for words in rest[1 : 1 + vertex_count]], np.float64)
        faces = [[int(word) for word in words[1 : 1 + int(words[0])]] for words in rest[1 + vertex_count :]]
        sizes = np.array([int(words[0]) for words in rest[1 + vertex_count :]], np.int64)
        if any(len(face) != size or size < FEWEST_CORNERS for face, size in zip(faces, sizes, strict=True)):
            raise ValueError("a face has fewer corners than it says, or than three")
        corners = np.array([corner for face in faces for corner in face], np.int64)
        return Polygons(vertices.reshape(-1, 3), sizes, corners)
    except (ValueError, IndexError, OverflowError) as error:
        raise UserError(
            f"{path} cannot be read as OFF ({error}); it was cut off or damaged. Export the mesh again."
        ) from error


def _lines_of(path: Path) -> Iterator[tuple[int, list[bytes]]]:
    """Words of each line that has any, with its number; comments left out, continued lines joined.

    Comments, and names of files as Windows writes them, may end with a backslash that continues nothing; and
    a number that is none begins with ``1.#`` there.
    """
    begun: list[bytes] = []
    for number, line in enumerate(path.read_bytes().removeprefix(BOM).splitlines(), 1):
        words = line.split()
        comment = next((k for k, word in enumerate(words) if word.startswith(b"#")), len(words))
        words = begun + words[:comment]
        begun = []
        if words and words[0] in CONTINUED and words[-1].endswith(b"\\"):
            begun = [*words[:-1], *filter(None, [words[-1][:-1]])]
        elif words:
            yield number, words
    if begun:
        yield number, begun


def _position(words: list[bytes]) -> list[float]:
    if len(words) < 4:
        raise ValueError("a position has three numbers")
    return [float(word) for word in words[1:4]]


def _texture_coordinate(words: list[bytes]) -> list[float]:
    """Read u and v; v is 0 where a curve has u alone, a third number says nothing of an image."""
    if len(words) < 2:
        raise ValueError("a texture coordinate has one number or more")
    return [float(words[1]), float(words[2]) if len(words) > 2 else 0.0]


def _size(words: list[bytes]) -> int:
    if len(words) - 1 < FEWEST_CORNERS:
        raise ValueError("a face has three corners or more")
    return len(words) - 1


def _corner(word: bytes, seen: tuple[int, ...]) -> tuple[int, ...]:
    """Place, texture coordinate and normal of ``7``, ``7/1``, ``7//3`` or ``7/1/3``, from 0; −1 for none."""
    position, *others = word.split(b"/")
    indices = [_index(one, there) if one else -1 for one, there in zip(others, seen[1:], strict=False)]
    return (_index(position, seen[0]), *indices, *[-1] * (2 - len(indices)))


def _index(word: bytes, there: int) -> int:
    """From 0, of a number that counts from 1, or backwards from what is there so far."""
    number = int(word)
    if number == 0 or not -there <= number <= LARGEST_INDEX:
        raise ValueError(f"{number} names nothing")
    return number - 1 if number > 0 else there + number
