"""GLB files, read whole or refused: what is not read here is refused by name."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import UserError
from stages.formats.meshes.glb_primitives import (
    COMPONENTS,
    KINDS,
    Primitive,
    nodes_of,
    placed_primitives,
    triangles_of,
)
from stages.formats.meshes.polygons import NO_UV, Polygons, UVMap, distinct, material_numbers

NOTHING_PLACED = Primitive(np.zeros((0, 3)), np.zeros((0, 3), np.int64), None, None)
MOST_NODES = 10_000  # seconds, and the time grows faster than they do
MOST_PER_BYTE, FEWEST_ALLOWED = 64, 1 << 22  # morphs and instances are laid out longer than they are stored
HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_")  # say nothing of the shape
INSTANCING, DRACO = "EXT_mesh_gpu_instancing", "KHR_draco_mesh_compression"


def read_glb(path: Path) -> Polygons:
    """Read the triangles of all meshes where the default scene places them.

    Raises
    ------
    UserError
        It is shorter or longer than it says, its primitives name what is not there, it keeps its data in
        another file, or uses what is not read here: compression, instances, sparse or packed coordinates,
        skins, morphs.
    """
    return read_glb_with_uv(path)[0]


def read_glb_with_uv(path: Path) -> tuple[Polygons, UVMap]:
    """Read the triangles of a GLB, its first texture coordinates and its materials.

    Raises
    ------
    UserError
        As `read_glb`.
    """
    data = path.read_bytes()
    try:
        content, binary = _chunks(data)
        _check_promises(content, len(data))
        unread = _unread(content)
        placed = [] if unread else list(placed_primitives(content, binary))
    except (
        LookupError,
        ValueError,
        TypeError,
        AttributeError,
        RecursionError,
        OverflowError,
        struct.error,
    ) as error:
        raise UserError(
            f"{path} does not hold what it promises ({' '.join(str(error).split())[:200]}); it was cut off "
            "or damaged. Copy or export it again."
        ) from error
    if unread:
        raise UserError(
            f"{path} uses {unread}, which is not read here; expected plain triangles. Export it without, or "
            "as PLY."
        )
    return _joined(placed or [NOTHING_PLACED], content.get("materials", []))


def _joined(placed: list[Primitive], materials: list[dict[str, Any]]) -> tuple[Polygons, UVMap]:
    """Join primitives, vertices after vertices: each has a texture coordinate of its own."""
    starts = np.cumsum([0, *(len(one.vertices) for one in placed)])
    faces = np.concatenate([one.faces + start for one, start in zip(placed, starts[:-1], strict=True)])
    without = np.concatenate([np.full(len(one.vertices), one.uv is None) for one in placed])
    uv = np.concatenate([np.zeros((len(one.vertices), 2)) if one.uv is None else one.uv for one in placed])
    corners = faces.reshape(-1)
    names = distinct([str(one.get("name") or f"material_{n}") for n, one in enumerate(materials)])
    of_primitives, named = material_numbers(
        ["" if one.material is None else names[one.material] for one in placed]
    )
    material = np.repeat(of_primitives, [len(one.faces) for one in placed])
    uv_map = UVMap(uv, np.where(without[corners], NO_UV, corners), material, named, v_upwards=False)
    vertices = np.concatenate([one.vertices for one in placed])
    return Polygons(vertices, np.full(len(faces), 3, np.int64), corners), uv_map


def _chunks(data: bytes) -> tuple[dict[str, Any], bytes]:
    """Divide the file into its JSON and the bytes of its first buffer."""
    magic, version, length = struct.unpack_from("<4sII", data)
    if magic != b"glTF" or version != 2:
        raise ValueError("it is no GLB of version 2")
    if length != len(data):
        raise ValueError(f"it says that it has {length} bytes and has {len(data)}")
    (size,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def _check_promises(content: dict[str, Any], length: int) -> None:
    """Refuse tables that would be laid out far beyond what the file holds.

    An accessor without data is zeros, and views may share their bytes: a few bytes can promise terabytes.
    """
    laid_out = sum(
        one["count"] * np.dtype(KINDS[one["componentType"]]).itemsize * COMPONENTS[one["type"]]
        for one in content.get("accessors", [])
    )
    sliced = sum(one["byteLength"] for one in content.get("bufferViews", []))
    if len(nodes := nodes_of(content)) > MOST_NODES:
        raise ValueError(
            f"its scene has {len(nodes)} nodes, of which at most {MOST_NODES} are read: join them"
        )
    placed = sum(triangles_of(content, primitive) for primitive in _placed(content))
    for size, what in ((laid_out, "bytes of numbers"), (sliced, "bytes of views"), (placed, "triangles")):
        most = FEWEST_ALLOWED + MOST_PER_BYTE * length
        if not 0 <= size <= most:
            raise ValueError(f"it promises {size} {what} and has {length} bytes")


def _placed(content: dict[str, Any]) -> list[dict[str, Any]]:
    """Primitives of all meshes, as often as the scene places them."""
    meshes = [content["meshes"][node["mesh"]] for node in nodes_of(content) if "mesh" in node]
    return [primitive for mesh in meshes for primitive in mesh["primitives"]]


def _unread(content: dict[str, Any]) -> str:
    """What the library would pass over, in words; empty where there is nothing."""
    required = [one for one in content.get("extensionsRequired", []) if not one.startswith(HARMLESS)]
    if required:
        return ", ".join(required)
    if any("uri" in one and not one["uri"].startswith("data:") for one in content.get("buffers", [])):
        return "data in another file"
    nodes, placed = nodes_of(content), _placed(content)
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
