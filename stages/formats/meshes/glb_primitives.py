"""Primitives of a GLB where its scene places them: positions, triangles, texture coordinates, materials."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

Content = dict[str, Any]
TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of primitives; points and lines below
KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}  # of componentType
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


@dataclass(frozen=True, eq=False)
class Primitive:
    """A primitive of triangles, placed.

    Attributes
    ----------
    vertices : ndarray, shape (v, 3), float64
        In the scene.
    faces : ndarray, shape (f, 3), int64
        Right hand outwards, there too where the scene mirrors it.
    uv : ndarray, shape (v, 2), float64, or None
        v downwards.
    material : int or None
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None
    material: int | None


def placed_primitives(content: Content, binary: bytes) -> Iterator[Primitive]:
    """Read the primitives of all meshes as often as the default scene places them, in its order.

    Raises
    ------
    LookupError, TypeError, ValueError
        The content names what is not there, or what its bytes do not hold.
    """
    buffers = [_bytes_of(buffer, binary) for buffer in content.get("buffers", [])]
    for node, scene_from_node in _placements(content):
        if "mesh" not in node:
            continue
        for primitive in content["meshes"][node["mesh"]]["primitives"]:
            if primitive.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN):
                yield _placed(content, buffers, primitive, scene_from_node)


def nodes_of(content: Content) -> list[Content]:
    """List all nodes that the default scene reaches.

    Raises
    ------
    ValueError
        It reaches one twice.
    """
    return [node for node, _ in _placements(content)]


def triangles_of(content: Content, primitive: Content) -> int:
    """Count the triangles that a primitive promises."""
    corners = content["accessors"][primitive.get("indices", primitive["attributes"]["POSITION"])]["count"]
    mode = primitive.get("mode", TRIANGLES)
    if mode == TRIANGLES:
        return corners // 3
    return max(corners - 2, 0) if mode in (STRIP, FAN) else 0


def _placements(content: Content) -> Iterator[tuple[Content, np.ndarray]]:
    """Walk the default scene, children after their parent; with the matrix that places each node."""
    nodes, scenes = content.get("nodes", []), content.get("scenes", [])
    roots = scenes[content.get("scene", 0)].get("nodes", []) if scenes else []
    waiting, reached = [(number, np.eye(4)) for number in reversed(roots)], 0
    while waiting:
        number, scene_from_parent = waiting.pop()
        node = nodes[number]
        scene_from_node = scene_from_parent @ _parent_from_node(node)
        waiting += [(child, scene_from_node) for child in reversed(node.get("children", []))]
        reached += 1
        if reached > len(nodes):
            raise ValueError("a node is there twice")
        yield node, scene_from_node


def _parent_from_node(node: Content) -> np.ndarray:
    """Build a node's matrix, (4, 4), which may be given as translation, rotation (x, y, z, w) and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = (float(number) for number in node.get("rotation", (0, 0, 0, 1)))
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] = np.array(rotation) * np.array(node.get("scale", (1, 1, 1)), np.float64).reshape(3)
    matrix[:3, 3] = np.array(node.get("translation", (0, 0, 0)), np.float64).reshape(3)
    return matrix


def _placed(
    content: Content, buffers: list[bytes], primitive: Content, scene_from_node: np.ndarray
) -> Primitive:
    attributes = primitive["attributes"]
    vertices = _values(content, buffers, attributes["POSITION"]).astype(np.float64).reshape(-1, 3)
    corners = np.arange(len(vertices))
    if "indices" in primitive:
        corners = _values(content, buffers, primitive["indices"]).astype(np.int64).reshape(-1)
    if len(corners) and not 0 <= corners.min() <= corners.max() < len(vertices):
        raise ValueError(f"a face names vertex {corners.max()} of {len(vertices)}")
    faces = _faces(corners, primitive.get("mode", TRIANGLES))
    if _mirrors(scene_from_node):
        faces = faces[:, ::-1]
    uv = None
    if "TEXCOORD_0" in attributes:
        uv = _texture_coordinates(content, buffers, attributes["TEXCOORD_0"])
        if uv.shape != (len(vertices), 2):
            raise ValueError(f"{len(uv)} texture coordinates of {len(vertices)} vertices")
    placed = vertices @ scene_from_node[:3, :3].T + scene_from_node[:3, 3]
    return Primitive(placed, faces, uv, primitive.get("material"))


def _mirrors(scene_from_node: np.ndarray) -> bool:
    """Test whether a matrix makes a left hand of a right one; what is beyond all bounds is refused later."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.linalg.det(scene_from_node[:3, :3]) < 0)


def _faces(corners: np.ndarray, mode: int) -> np.ndarray:
    """Lay out triangles, strips or fans, (c,), as triangles, (f, 3)."""
    if mode == TRIANGLES:
        return corners.reshape(-1, 3)
    count = max(len(corners) - 2, 0)
    k = np.arange(count)
    first = k if mode == STRIP else np.zeros(count, np.int64)
    odd = k % 2 if mode == STRIP else np.zeros(count, np.int64)
    return corners[np.stack([first, k + 1 + odd, k + 2 - odd], axis=1)]


def _texture_coordinates(content: Content, buffers: list[bytes], number: int) -> np.ndarray:
    """Read texture coordinates; whole numbers are shares of their type's greatest."""
    values = _values(content, buffers, number)
    greatest = np.iinfo(values.dtype).max if np.issubdtype(values.dtype, np.integer) else 1
    return values.astype(np.float64) / greatest


def _values(content: Content, buffers: list[bytes], number: int) -> np.ndarray:
    """Read an accessor, (count, components), in the type that it declares; zeros where it has no view."""
    accessor = content["accessors"][number]
    kind, components = np.dtype(KINDS[accessor["componentType"]]), COMPONENTS[accessor["type"]]
    count, item = accessor["count"], kind.itemsize * components
    if "bufferView" not in accessor:
        return np.zeros((count, components), kind)
    view = content["bufferViews"][accessor["bufferView"]]
    stride, offset = view.get("byteStride", item), accessor.get("byteOffset", 0)
    start, data = view.get("byteOffset", 0), buffers[view["buffer"]]
    end = offset + stride * (count - 1) + item if count else offset
    if min(count, offset, start, stride - item) < 0 or end > view["byteLength"] or start + end > len(data):
        raise ValueError(f"{count} values of accessor {number} are not there")
    return np.ndarray((count, components), kind, data, start + offset, (stride, kind.itemsize))


def _bytes_of(buffer: Content, binary: bytes) -> bytes:
    """Return the bytes of a buffer: those of a data URI, or the file's own."""
    if "uri" in buffer:
        return base64.b64decode(buffer["uri"].partition(",")[2], validate=True)
    return binary
