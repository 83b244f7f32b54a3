"""GLB through trimesh, as far as that reads it right: what it passes over silently is refused here."""

from __future__ import annotations

import json
import struct
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from pipeline import UserError
from stages.formats.meshes.polygons import Polygons

TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of primitives; points and lines below
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MOST_NODES = 10_000  # seconds, and the time grows faster than they do
MOST_PER_BYTE, FEWEST_ALLOWED = 64, 1 << 22  # morphs and instances are laid out longer than they are stored
HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_")  # say nothing of the shape
INSTANCING, DRACO = "EXT_mesh_gpu_instancing", "KHR_draco_mesh_compression"


def read_glb(path: Path) -> Polygons:
    """Read the triangles of all meshes where the default scene places them.

    Raises
    ------
    UserError
        It is shorter or longer than it says, holds another number of triangles than could be read, keeps its
        data in another file, or uses what is not read here: compression, instances, sparse or packed
        coordinates, skins, morphs.
    """
    data = path.read_bytes()
    try:
        content = _content(data)
        promised = _promised_triangles(content, len(data))
        unread = _unread(content)
    except (LookupError, ValueError, TypeError, AttributeError, RecursionError, struct.error) as error:
        raise UserError(
            f"{path} does not hold what it promises ({' '.join(str(error).split())[:200]}); it was cut off "
            "or damaged. Copy or export it again."
        ) from error
    if unread:
        raise UserError(
            f"{path} uses {unread}, which is not read here; expected plain triangles. Export it without, or "
            "as PLY."
        )
    mesh = _read(path, data)
    if len(mesh.faces) != promised:
        raise UserError(
            f"{path} says that it holds {promised} triangles, and {len(mesh.faces)} could be read; export it "
            "again, or as PLY."
        )
    faces = np.asarray(mesh.faces, np.int64)
    return Polygons(
        np.asarray(mesh.vertices, np.float64), np.full(len(faces), 3, np.int64), faces.reshape(-1)
    )


def _read(path: Path, data: bytes) -> trimesh.Trimesh:
    try:
        return trimesh.load_scene(
            BytesIO(data), file_type="glb", process=False, skip_materials=True
        ).to_mesh()
    except Exception as error:  # the library raises whatever its parsers meet
        reason = " ".join(str(error).split())[:200]
        raise UserError(f"{path} cannot be read ({reason}); export it again, or as PLY.") from error


def _content(data: bytes) -> dict[str, Any]:
    magic, version, length = struct.unpack_from("<4sII", data)
    if magic != b"glTF" or version != 2:
        raise ValueError("it is no GLB of version 2")
    if length != len(data):
        raise ValueError(f"it says that it has {length} bytes and has {len(data)}")
    (size,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + size])


def _promised_triangles(content: dict[str, Any], length: int) -> int:
    """Count triangles; refuse tables that a library would lay out far beyond what the file holds.

    An accessor without data is zeros, and views may share their bytes: a few bytes can promise terabytes.
    """
    widths = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}  # bytes of componentType
    laid_out = sum(
        one["count"] * widths[one["componentType"]] * COMPONENTS[one["type"]]
        for one in content.get("accessors", [])
    )
    sliced = sum(one["byteLength"] for one in content.get("bufferViews", []))
    if len(nodes := _nodes(content)) > MOST_NODES:
        raise ValueError(
            f"its scene has {len(nodes)} nodes, of which at most {MOST_NODES} are read: join them"
        )
    placed = sum(_triangles(content, primitive) for primitive in _placed(content))
    for size, what in ((laid_out, "bytes of numbers"), (sliced, "bytes of views"), (placed, "triangles")):
        most = FEWEST_ALLOWED + MOST_PER_BYTE * length
        if not 0 <= size <= most:
            raise ValueError(f"it promises {size} {what} and has {length} bytes")
    return placed


def _nodes(content: dict[str, Any]) -> list[dict[str, Any]]:
    """All that the default scene reaches."""
    nodes, scenes = content.get("nodes", []), content.get("scenes", [])
    waiting = list(scenes[content.get("scene", 0)].get("nodes", [])) if scenes else []
    reached = []
    while waiting:
        reached.append(nodes[waiting.pop()])
        waiting += reached[-1].get("children", [])
        if len(reached) > len(nodes):
            raise ValueError("a node is there twice")
    return reached


def _placed(content: dict[str, Any]) -> list[dict[str, Any]]:
    """Primitives of all meshes, as often as the scene places them."""
    meshes = [content["meshes"][node["mesh"]] for node in _nodes(content) if "mesh" in node]
    return [primitive for mesh in meshes for primitive in mesh["primitives"]]


def _triangles(content: dict[str, Any], primitive: dict[str, Any]) -> int:
    corners = content["accessors"][primitive.get("indices", primitive["attributes"]["POSITION"])]["count"]
    mode = primitive.get("mode", TRIANGLES)
    if mode == TRIANGLES:
        return corners // 3
    return max(corners - 2, 0) if mode in (STRIP, FAN) else 0


def _unread(content: dict[str, Any]) -> str:
    """What the library would pass over, in words; empty where there is nothing."""
    required = [one for one in content.get("extensionsRequired", []) if not one.startswith(HARMLESS)]
    if required:
        return ", ".join(required)
    if any("uri" in one and not one["uri"].startswith("data:") for one in content.get("buffers", [])):
        return "data in another file"
    nodes, placed = _nodes(content), _placed(content)
    if any(INSTANCING in node.get("extensions", {}) for node in nodes):
        return INSTANCING
    if any("skin" in node for node in nodes):
        return "a skin"
    if any(any(each) for each in (node.get("weights", ()) for node in nodes)) or any(
        any(mesh.get("weights", ())) for mesh in content.get("meshes", [])
    ):
        return "morphs"
    if any(DRACO in primitive.get("extensions", {}) for primitive in placed):
        return DRACO
    used = {primitive["attributes"]["POSITION"] for primitive in placed}
    used |= {primitive["indices"] for primitive in placed if "indices" in primitive}
    accessors = [content["accessors"][number] for number in sorted(used)]
    if any("sparse" in accessor for accessor in accessors):
        return "sparse accessors"
    return "packed coordinates" if any(accessor.get("normalized") for accessor in accessors) else ""
