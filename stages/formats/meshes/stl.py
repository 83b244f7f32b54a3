"""STL, text or binary: three corners for every triangle, read whole or refused."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from pipeline import UserError
from stages.formats.meshes.polygons import Polygons

HEADER = 84  # bytes: a title, and how many triangles there are
TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
BOM = b"\xef\xbb\xbf"


def read_stl(path: Path) -> Polygons:
    """Read all triangles of all solids, each with corners of its own.

    Raises
    ------
    UserError
        It is shorter or longer than it says, or no STL.
    """
    data = path.read_bytes()
    try:
        corners = _of_binary(data) if _is_binary(data) else _of_text(data)
    except (ValueError, IndexError) as error:
        raise UserError(
            f"{path} cannot be read as STL ({error}); it was cut off or damaged. Copy or export it again."
        ) from error
    count = len(corners)
    return Polygons(corners.reshape(-1, 3), np.full(count // 3, 3, np.int64), np.arange(count))


def _is_binary(data: bytes) -> bool:
    """By its length: titles of binary files may begin with ``solid``, too. Some bytes more do no harm."""
    if len(data) < HEADER:
        return False
    (count,) = struct.unpack_from("<I", data, HEADER - 4)
    return 0 <= len(data) - HEADER - count * TRIANGLE.itemsize < TRIANGLE.itemsize


def _of_binary(data: bytes) -> np.ndarray:
    (count,) = struct.unpack_from("<I", data, HEADER - 4)
    return np.frombuffer(data, TRIANGLE, count, HEADER)["corners"].reshape(-1, 3).astype(np.float64)


def _of_text(data: bytes) -> np.ndarray:
    """Corners (3 t, 3): lines by their first words, so that a solid may be called what it likes."""
    lines = [words for line in data.removeprefix(BOM).splitlines() if (words := line.lower().split())]
    if not lines or lines[0][0] != b"solid":
        raise ValueError(f"{len(data)} bytes are neither text nor what its number of triangles takes")
    kinds = [words[0] for words in lines]
    corners = [words[1:4] for words in lines if words[0] == b"vertex"]
    facets = [words for words in lines if words[:2] == [b"facet", b"normal"]]
    if not 3 * len(facets) == 3 * kinds.count(b"endfacet") == len(corners):
        raise ValueError("a triangle is not whole")
    last_facet = max((k for k, kind in enumerate(kinds) if kind == b"endfacet"), default=0)
    if b"endsolid" not in kinds[last_facet:]:
        raise ValueError("there is no endsolid after its last triangle")
    return np.array(corners, np.float64).reshape(-1, 3)
