"""Chunks of PNG files, checked before a decoder sets memory aside for what their lengths promise."""

from __future__ import annotations

import struct

SIGNATURE = b"\x89PNG\r\n\x1a\n"
AROUND = 12  # bytes of length, kind and checksum


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
