"""Strict JSON: NaN and infinities become null."""

from __future__ import annotations

import json
import math
from typing import Any


def json_text(value: Any, indent: int | None = None) -> str:
    r"""Encode plain values as JSON, with null for NaN and infinities, which JSON lacks.

    Bytes of a file's name that are not UTF-8 are lone surrogates in Python; they are written as ``\udcXX``.
    """
    text = json.dumps(finite_or_null(value), indent=indent, ensure_ascii=False, allow_nan=False)
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def finite_or_null(value: Any) -> Any:
    """Replace NaN and infinities in the same structure by None, which JSON writes as null."""
    if isinstance(value, dict):
        return {key: finite_or_null(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [finite_or_null(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
