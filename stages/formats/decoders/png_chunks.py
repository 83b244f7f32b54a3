"""Chunks of PNG files: checked before a decoder sets memory aside for their lengths; colour, said in them."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

SIGNATURE = b"\x89PNG\r\n\x1a\n"
AROUND = 12  # bytes of length, kind and checksum
LONGEST_CHUNK = 1 << 24  # bytes
HEADER = len(SIGNATURE) + AROUND + 13  # bytes, IHDR included
SRGB = (  # as the standard asks for: PNG 11.3.2.5, with what older readers know of it
    (b"sRGB", bytes([0])),  # perceptual
    (b"gAMA", struct.pack(">I", 45455)),
    (b"cHRM", struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)),
)


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


def said_to_be_srgb(data: bytes, exif: bytes = b"") -> bytes:
    """Insert the chunks that say that a PNG's colours are sRGB, and EXIF data (from their byte order on)."""
    said = (*SRGB, (b"eXIf", exif)) if exif else SRGB
    chunks = b"".join(
        struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
        for kind, content in said
    )
    return data[:HEADER] + chunks + data[HEADER:]


def chunks_before_pixels(path: Path) -> dict[bytes, bytes]:
    """Read the chunks of a PNG before its pixels, by name; Pillow tells of few. Of other files, none."""
    chunks: dict[bytes, bytes] = {}
    with path.open("rb") as file:
        if file.read(8) != SIGNATURE:
            return chunks
        while len(head := file.read(8)) == 8 and head[4:] != b"IDAT":
            chunks[head[4:]] = file.read(min(int.from_bytes(head[:4], "big"), LONGEST_CHUNK) + 4)[:-4]
    return chunks
