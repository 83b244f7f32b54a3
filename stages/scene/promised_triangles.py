"""How many triangles an STL or GLB says that it holds, to be compared with what a library made of it."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from pipeline import UserError

STL_HEADER, STL_TRIANGLE = 84, 50  # bytes
GLB_TRIANGLES, GLB_STRIP, GLB_FAN = 4, 5, 6  # modes of primitives; points and lines below


def promised_triangles(path: Path) -> int:
    """Count the triangles that the file says it holds.

    Raises
    ------
    UserError
        It is shorter or longer than it says itself, or is no STL or GLB.
    """
    data = path.read_bytes()
    try:
        return _of_stl(data) if path.suffix.lower() == ".stl" else _of_glb(data)
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, struct.error) as error:
        raise UserError(
            f"{path} does not hold what it promises ({' '.join(str(error).split())[:200]}); it was cut off "
            "or damaged. Copy or export it again."
        ) from error


def _of_stl(data: bytes) -> int:
    """Binary by its length; else text, which ends with ``endsolid``."""
    if len(data) >= STL_HEADER:
        count = struct.unpack_from("<I", data, STL_HEADER - 4)[0]
        if len(data) == STL_HEADER + STL_TRIANGLE * count:
            return count
    text = data.lower()
    if not text.lstrip().startswith(b"solid") or b"facet" not in text:
        raise ValueError(f"{len(data)} bytes are neither text nor what its number of triangles takes")
    if b"endsolid" not in text[text.rindex(b"facet") :]:
        raise ValueError("no endsolid at its end")
    if not text.count(b"facet normal") == text.count(b"endfacet") == text.count(b"vertex") / 3:
        raise ValueError("a triangle is not whole")
    return text.count(b"endfacet")


def _of_glb(data: bytes) -> int:
    """Over all nodes that the default scene reaches."""
    magic, version, length = struct.unpack_from("<4sII", data)
    if magic != b"glTF" or version != 2:
        raise ValueError("it is no GLB of version 2")
    if length != len(data):
        raise ValueError(f"it says that it has {length} bytes and has {len(data)}")
    size, _ = struct.unpack_from("<I4s", data, 12)
    content = json.loads(data[20 : 20 + size])
    nodes = content.get("nodes", [])
    scenes = content.get("scenes", [])
    waiting = list(scenes[content.get("scene", 0)].get("nodes", [])) if scenes else list(range(len(nodes)))
    total, visits = 0, 0
    while waiting:
        node = nodes[waiting.pop()]
        visits += 1
        if visits > len(nodes):
            raise ValueError("a node is its own child")
        waiting += node.get("children", [])
        if "mesh" in node:
            total += sum(_of_primitive(content, one) for one in content["meshes"][node["mesh"]]["primitives"])
    return total


def _of_primitive(content: dict[str, Any], primitive: dict[str, Any]) -> int:
    corners = content["accessors"][primitive.get("indices", primitive["attributes"]["POSITION"])]["count"]
    mode = primitive.get("mode", GLB_TRIANGLES)
    if mode == GLB_TRIANGLES:
        return corners // 3
    return max(corners - 2, 0) if mode in (GLB_STRIP, GLB_FAN) else 0
