"""PLY files, read whole or refused: open3d takes what is left of a file that was cut."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import UserError
from stages.formats.meshes.polygons import FEWEST_CORNERS, Polygons

TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
INDICES = ("vertex_indices", "vertex_index")
TEXTURE_FILE = ["comment", "TextureFile"]
LONGEST_HEADER = 1 << 20  # bytes
END_OF_HEADER = re.compile(rb"ply[ \t]*(\r\n|\n|\r)((?:.*?(?:\r\n|\n|\r))??)end_header[ \t]*\1", re.DOTALL)
MOST_PROPERTIES = 256  # of an element; scans with all their attributes have some thirty
PADDING = 16  # bytes at most after a binary body
Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Property:
    """A named value of an element, or a list of them: `counted` is then the type of its length."""

    name: str
    type: str
    counted: str | None = None


@dataclass(frozen=True)
class Element:
    """What a header promises: so many rows of these properties."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def fewest_bytes(self) -> int:
        """Of a row in binary, its lists being empty."""
        return sum(np.dtype(one.counted or one.type).itemsize for one in self.properties)


@dataclass(frozen=True, eq=False)
class Ply:
    """A file's vertices, column by column, and its faces.

    Attributes
    ----------
    vertex : mapping of str to ndarray, shape (v,)
        By property name, in the types that the header declares.
    sizes, corners : ndarray
        As in `Polygons`; empty where there are no faces.
    face : mapping of str to ndarray
        What else the file has of faces; of a list, all its items in a row, and ``NAME sizes``.
    textures : tuple of str
        Names of images, as MeshLab writes them in comments.
    """

    vertex: Columns
    sizes: np.ndarray
    corners: np.ndarray
    face: Columns = field(default_factory=dict)
    textures: tuple[str, ...] = ()

    def columns(self, *names: str) -> np.ndarray | None:
        """Stack vertex properties, (v, n), float64; None where one of them is missing."""
        return self._side_by_side(names) if set(names) <= self.vertex.keys() else None

    @property
    def positions(self) -> np.ndarray:
        """Of the vertices, (v, 3), float64: no file is read that lacks them."""
        return self._side_by_side(("x", "y", "z"))

    def polygons(self) -> Polygons:
        """Collect the faces over the vertices' positions."""
        return Polygons(self.positions, self.sizes, self.corners)

    def _side_by_side(self, names: tuple[str, ...]) -> np.ndarray:
        return np.stack([np.asarray(self.vertex[name], np.float64) for name in names], axis=1)


def read_ply(path: Path) -> Ply:
    """Read vertices and faces of a PLY, text or binary, faces of any size.

    Raises
    ------
    UserError
        It is no PLY, holds fewer or more rows than its header promises, has no x, y, z, or a face with
        fewer than three corners.
    """
    data = path.read_bytes()
    order, elements, textures, start = _read_header(path, data)
    found = {}
    try:
        rows = _TextRows(data[start:]) if order == "" else _BinaryRows(data, start, order)
        for element in elements:
            found[element.name] = rows.take(element)
        rows.end()
    except (ValueError, IndexError, OverflowError, struct.error) as error:
        promised = ", ".join(f"{element.count} {element.name}" for element in elements)
        raise UserError(
            f"{path} does not hold what its header promises ({promised}; {error}); it was cut off or "
            "damaged. Copy or export it again."
        ) from error
    vertex = {name: column for name, column in found.get("vertex", {}).items() if column.ndim == 1}
    if not {"x", "y", "z"} <= vertex.keys():
        raise UserError(
            f"{path} has no vertices with x, y and z; expected a mesh or points. Export it again."
        )
    faces = found.get("face", {})
    name = next((name for name in INDICES if name in faces), None)
    if name is None:
        if "tristrips" in found:
            raise UserError(f"{path} holds strips of triangles; expected faces. Export it again, or as OBJ.")
        return Ply(vertex, np.zeros(0, np.int64), np.zeros(0, np.int64))
    sizes, corners = faces[f"{name} sizes"], faces[name].reshape(-1)
    if len(sizes) and sizes.min() < FEWEST_CORNERS:
        raise UserError(
            f"{path} has a face with {sizes.min()} corners (number {int(sizes.argmin())}); expected three or "
            "more. Export the mesh again."
        )
    return Ply(vertex, sizes.astype(np.int64), _as_indices(path, corners), faces, textures)


def write_ply(path: Path, vertices: Mapping[str, np.ndarray], faces: np.ndarray | None = None) -> None:
    """Write a binary PLY, creating the folder.

    Parameters
    ----------
    path : Path
    vertices : mapping of str to ndarray, shape (v,)
        Columns by property name, in the types that the file is to have.
    faces : ndarray, shape (f, 3), optional
    """
    kinds = {"f4": "float", "f8": "double", "u1": "uchar", "u2": "ushort"}
    table = np.empty(
        len(next(iter(vertices.values()))), [(n, f"<{c.dtype.str[1:]}") for n, c in vertices.items()]
    )
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    for name, column in vertices.items():
        table[name] = column
        header.append(f"property {kinds[column.dtype.str[1:]]} {name}")
    body = table.tobytes()
    if faces is not None:
        triangles = np.empty(len(faces), [("size", "u1"), ("corners", "<i4", (3,))])
        triangles["size"], triangles["corners"] = 3, faces
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
        body += triangles.tobytes()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(("\n".join([*header, "end_header"]) + "\n").encode("ascii") + body)


def _as_indices(path: Path, corners: np.ndarray) -> np.ndarray:
    if not len(corners):
        return np.zeros(0, np.int64)
    whole = corners.astype(np.int64)
    if not np.array_equal(whole, corners):
        raise UserError(f"{path} has faces whose corners are no whole numbers; export the mesh again.")
    return whole


def _read_header(path: Path, data: bytes) -> tuple[str, list[Element], tuple[str, ...], int]:
    """Byte order ("" for text), what is promised, names of textures, and where the body begins."""
    head = END_OF_HEADER.match(data[:LONGEST_HEADER])
    if head is None:
        raise UserError(f"{path} has no PLY header; expected a file that begins with 'ply'. Export it again.")
    lines, start = head[2].decode("ascii", "replace").splitlines(), head.end()
    order, elements, textures = "", list[Element](), []
    try:
        for words in filter(None, (line.split() for line in lines)):
            if words[:2] == TEXTURE_FILE:
                textures.append(" ".join(words[2:]))
            elif words[0] == "format":
                order = ORDERS[words[1]]
            elif words[0] == "element":
                elements.append(Element(words[1], _count(words[2]), ()))
            elif words[0] == "property":
                last = elements.pop()
                if len(last.properties) == MOST_PROPERTIES:
                    raise ValueError(f"more than {MOST_PROPERTIES} properties of {last.name}")
                one = _property(words, {other.name for other in last.properties})
                elements.append(Element(last.name, last.count, (*last.properties, one)))
    except (KeyError, IndexError, ValueError) as error:
        raise UserError(
            f"{path} has a PLY header that makes no sense ({error}); export the mesh again."
        ) from error
    for element in elements:
        if order and element.count * element.fewest_bytes > len(data) - start:
            raise UserError(
                f"{path} promises {element.count} rows of {element.name} and holds {len(data)} bytes in all; "
                "it was cut off or damaged. Copy or export it again."
            )
    return order, elements, tuple(textures), start


def _count(word: str) -> int:
    if int(word) < 0:
        raise ValueError(f"{word} rows")
    return int(word)


def _property(words: list[str], taken: set[str]) -> Property:
    """A header's line; the second of one name is called otherwise, for the first is meant."""
    listed = words[1] == "list"
    name = words[4] if listed else words[2]
    while name in taken:
        name += " again"
    return Property(name, TYPES[words[3]], TYPES[words[2]]) if listed else Property(name, TYPES[words[1]])


class _BinaryRows:
    """Rows of a binary body, taken element by element."""

    def __init__(self, data: bytes, start: int, order: str) -> None:
        self._data, self._at, self._order = data, start, order

    def take(self, element: Element) -> dict[str, np.ndarray]:
        """Take the columns of the next element; of a list, all its items in a row, and `NAME sizes`."""
        if not element.count or not element.properties:
            return _no_rows(element)
        uniform = self._with_lists_as_the_first(element)
        return self._one_by_one(element) if uniform is None else uniform

    def end(self) -> None:
        """Refuse bytes beyond the header's rows, but for a line's end or zeros, as some editors leave."""
        left = self._data[self._at :]
        if left.strip(b"\0\r\n ") or len(left) > PADDING:
            raise ValueError(f"{len(left)} bytes are left over")

    def _with_lists_as_the_first(self, element: Element) -> dict[str, np.ndarray] | None:
        """All rows at once, if all their lists are as long as those of the first."""
        fields: list[tuple[str, np.dtype] | tuple[str, np.dtype, tuple[int]]] = []
        at = self._at
        for one in element.properties:
            kind = np.dtype(self._order + one.type)
            if one.counted is None:
                fields.append((one.name, kind))
                at += kind.itemsize
                continue
            counted = np.dtype(self._order + one.counted)
            length = int(np.frombuffer(self._data, counted, 1, at)[0])
            fields += [(f"{one.name} sizes", counted), (one.name, kind, (length,))]
            at += counted.itemsize + length * kind.itemsize
        row = np.dtype(fields)
        if self._at + element.count * row.itemsize > len(self._data):
            return None
        rows = np.frombuffer(self._data, row, element.count, self._at)
        lists = [one.name for one in element.properties if one.counted]
        if any((rows[f"{name} sizes"] != rows[f"{name} sizes"][0]).any() for name in lists):
            return None
        self._at += element.count * row.itemsize
        flat = {name: rows[name].reshape(-1) for name, *_ in fields}
        return {name: column.astype(column.dtype.newbyteorder("=")) for name, column in flat.items()}

    def _one_by_one(self, element: Element) -> dict[str, np.ndarray]:
        kinds = {name: np.dtype(name).char for name in TYPES.values()}
        found = _no_rows(element)
        values: dict[str, list[float]] = {name: [] for name in found}
        for _ in range(element.count):
            for one in element.properties:
                length = 1
                if one.counted is not None:
                    (length,) = self._unpack(kinds[one.counted])
                    values[f"{one.name} sizes"].append(length)
                values[one.name].extend(self._unpack(kinds[one.type], length))
        return {name: np.array(column, found[name].dtype) for name, column in values.items()}

    def _unpack(self, kind: str, count: int = 1) -> tuple[Any, ...]:
        layout = f"{self._order}{int(count)}{kind}"
        values = struct.unpack_from(layout, self._data, self._at)
        self._at += struct.calcsize(layout)
        return values


class _TextRows:
    """Rows of a text body: numbers in a row, however they are broken into lines."""

    def __init__(self, body: bytes) -> None:
        self._numbers = np.array(body.split(), np.float64)
        self._at = 0

    def take(self, element: Element) -> dict[str, np.ndarray]:
        """Take the columns of the next element, as `_BinaryRows.take`."""
        if not element.count or not element.properties:
            return _no_rows(element)
        uniform = self._with_lists_as_the_first(element)
        return self._one_by_one(element) if uniform is None else uniform

    def _with_lists_as_the_first(self, element: Element) -> dict[str, np.ndarray] | None:
        """All rows at once, if all their lists are as long as those of the first."""
        places: list[tuple[str, str, slice]] = []
        width, lists = 0, []
        for one in element.properties:
            length = 1
            if one.counted is not None:
                length = int(self._numbers[self._at + width])
                places.append((f"{one.name} sizes", one.counted, slice(width, width + 1)))
                lists.append(width)
                width += 1
            places.append((one.name, one.type, slice(width, width + length)))
            width += length
        exact = _in_lists(element)
        if min(length for length in (width, *(place[2].stop - place[2].start for place in places))) < 0:
            raise ValueError("a list is shorter than nothing")
        if self._at + element.count * width > len(self._numbers):
            return None
        rows = self._numbers[self._at : self._at + element.count * width].reshape(element.count, width)
        if any((rows[:, column] != rows[0, column]).any() for column in lists):
            return None
        self._at += element.count * width
        return {
            name: _typed(rows[:, place].reshape(-1), np.dtype(kind), name in exact)
            for name, kind, place in places
        }

    def end(self) -> None:
        """Refuse lines beyond the header's rows."""
        if self._at != len(self._numbers):
            raise ValueError(f"{len(self._numbers) - self._at} numbers are left over")

    def _one_by_one(self, element: Element) -> dict[str, np.ndarray]:
        values: dict[str, list[float]] = {name: [] for name in _no_rows(element)}
        exact = _in_lists(element)
        for _ in range(element.count):
            for one in element.properties:
                length = 1
                if one.counted is not None:
                    length = int(self._next(1)[0])
                    values[f"{one.name} sizes"].append(length)
                values[one.name].extend(self._next(length))
        return {
            name: _typed(np.array(column, np.float64), empty.dtype, name in exact)
            for (name, column), empty in zip(values.items(), _no_rows(element).values(), strict=True)
        }

    def _next(self, count: int) -> np.ndarray:
        if count < 0 or self._at + count > len(self._numbers):
            raise ValueError(f"only {len(self._numbers)} numbers are there")
        self._at += count
        return self._numbers[self._at - count : self._at]


def _in_lists(element: Element) -> set[str]:
    """List the columns that are lists or their lengths."""
    return {name for one in element.properties if one.counted for name in (one.name, f"{one.name} sizes")}


def _typed(numbers: np.ndarray, kind: np.dtype[Any], exact: bool) -> np.ndarray:
    """Convert a text's numbers to the type that the header declares; `exact`: refuse those beyond it.

    Corners and lengths would name something else, a colour is cut to its range.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        typed = numbers.astype(kind)
    if exact and np.issubdtype(kind, np.integer) and (typed != numbers).any():
        wrong = numbers[typed != numbers][0]
        raise ValueError(f"{wrong:.17g} is not of the type that the header declares, {kind.name}")
    return typed


def _no_rows(element: Element) -> dict[str, np.ndarray]:
    """Empty columns of an element."""
    empty = {}
    for one in element.properties:
        if one.counted is not None:
            empty[f"{one.name} sizes"] = np.zeros(0, one.counted)
        empty[one.name] = np.zeros(0, one.type)
    return empty
