"""Write GLB: glTF 2.0 in one file. trimesh's writer has no tangents and no targets of buffer views."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from pipeline import UserError
from pipeline.files.json_text import json_text

MAGIC, VERSION, JSON_CHUNK, BINARY_CHUNK = b"glTF", 2, b"JSON", b"BIN\0"
FLOAT, UINT32 = 5126, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
ALIGNMENT = 4
LARGEST_FILE = 2**32 - 1  # bytes: what the header can say
ROOM_FOR_TEXT = 1 << 24


class BinaryBuffer:
    """The one buffer of a GLB, and the views and accessors that divide it."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, data: bytes, target: int | None = None) -> int:
        """Append bytes; returns the number of their view."""
        self.data += bytes(-len(self.data) % ALIGNMENT)
        view: dict[str, int] = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append(view | ({} if target is None else {"target": target}))
        self.data += data
        return len(self.views) - 1

    def attribute(self, values: np.ndarray, bounded: bool = False) -> int:
        """Append values of vertices, (V, c), as float32; returns the number of their accessor.

        `bounded`: with their least and greatest, which positions need.
        """
        values = np.ascontiguousarray(values, "<f4")
        view = self.add(values.tobytes(), ARRAY_BUFFER)
        accessor: dict[str, Any] = {"bufferView": view, "componentType": FLOAT, "count": len(values)}
        accessor |= {"type": KINDS[values.shape[1]]}
        if bounded:
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def indices(self, faces: np.ndarray) -> int:
        """Append faces, (F, 3); returns the number of their accessor."""
        view = self.add(np.ascontiguousarray(faces, "<u4").tobytes(), ELEMENT_ARRAY_BUFFER)
        self.accessors.append(
            {"bufferView": view, "componentType": UINT32, "count": 3 * len(faces), "type": "SCALAR"}
        )
        return len(self.accessors) - 1


def packed(content: dict[str, Any], buffer: BinaryBuffer) -> bytes:
    """Pack a glTF and its buffer as GLB; buffers, views and accessors are added to the content.

    Raises
    ------
    UserError
        It is larger than a GLB can be.
    """
    if len(buffer.data) > LARGEST_FILE - ROOM_FOR_TEXT:
        raise UserError(
            f"The model would be a GLB of {len(buffer.data) / 1e9:.1f} GB; expected at most 4.2 GB, for the "
            "format has no larger ones. Lower texture.charts.most_px."
        )
    data = bytes(buffer.data) + bytes(-len(buffer.data) % ALIGNMENT)
    content = content | {
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    }
    text = json_text(content).encode()
    text += b" " * (-len(text) % ALIGNMENT)
    parts = [(JSON_CHUNK, text), (BINARY_CHUNK, data)]
    chunks = b"".join(struct.pack("<I", len(part)) + kind + part for kind, part in parts)
    return MAGIC + struct.pack("<II", VERSION, 12 + len(chunks)) + chunks
