"""Chunks of PNG files, checked before a decoder sets memory aside for what their lengths promise."""

from __future__ import annotations

import struct
from pathlib import Path

SIGNATURE = b"\x89PNG\r\n\x1a\n"
AROUND = 12  # bytes of length, kind and checksum
LONGEST_CHUNK = 1 << 24  # bytes


def fault_of_chunks(data: bytes) -> str:
    """Describe the first chunk that promises more bytes than the file has; empty for none, or no PNG."""
    if not data.startswith(SIGNATURE):
        return ""
    at = len(SIGNATURE)
    while at + AROUND <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        if length > len(data) - at - AROUND:
            return f"its part {kind!r} claims to have {length} bytes, more than the file"
        if kind == b"IEND":
            break
        at += AROUND + length
    return ""


def chunks_before_pixels(path: Path) -> dict[bytes, bytes]:
    """Read the chunks of a PNG before its pixels, by name; Pillow tells of few. Of other files, none."""
    chunks: dict[bytes, bytes] = {}
    with path.open("rb") as file:
        if file.read(8) != SIGNATURE:
            return chunks
        while len(head := file.read(8)) == 8 and head[4:] != b"IDAT":
            chunks[head[4:]] = file.read(min(int.from_bytes(head[:4], "big"), LONGEST_CHUNK) + 4)[:-4]
    return chunks
