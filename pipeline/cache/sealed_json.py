"""JSON files that begin with the digest of what follows, so that any changed byte is noticed.

The digest detects damage, not malice: whoever edits a file can also compute its digest.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from blake3 import blake3

from pipeline.files.file_kinds import FILE, kind_of_file
from pipeline.files.json_text import json_text

OPENING = b'{"digest": "'
HEX_DIGITS = 32
SEAL = len(OPENING) + HEX_DIGITS + 1  # bytes, with the closing quote


def sealed(values: Mapping[str, Any]) -> str:
    """Encode an object as JSON whose first member is the digest of the text after it."""
    text = json_text(dict(values), indent=1)
    rest = ("," if values else "") + text[1:] + "\n"
    return _seal(rest.encode("utf-8", "surrogateescape")).decode("ascii") + rest


def read_sealed(path: Path) -> dict[str, Any]:
    """Read an object that `sealed` encoded, or one without a digest, as earlier versions wrote it.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It was changed, or holds no object.
    """
    if kind_of_file(path) != FILE:  # reading a pipe would wait for ever
        raise ValueError(f"{path} is no file")
    data = path.read_bytes()
    if data.startswith(OPENING):
        seal, data = data[:SEAL], data[SEAL:]
        if seal != _seal(data):
            raise ValueError(f"{path} was changed: its digest is not that of its content")
        data = b"{" + data.removeprefix(b",")
    try:
        values = json.loads(data.decode("utf-8", "surrogateescape"))
    except RecursionError as error:
        raise ValueError(f"{path} is nested too deeply") from error
    if not isinstance(values, dict):
        raise ValueError(f"{path} holds {type(values).__name__}, not an object")
    return values


def _seal(rest: bytes) -> bytes:
    return OPENING + blake3(rest).hexdigest()[:HEX_DIGITS].encode("ascii") + b'"'
