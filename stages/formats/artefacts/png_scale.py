"""`png_scale.json`: the values that are white in the PNG files of the export."""

from __future__ import annotations

import json
from pathlib import Path


def png_whites(path: Path) -> dict[str, float]:
    """Read which value is white, by kind of map: `albedo`, `shading`."""
    whites: dict[str, float] = json.loads(path.read_text(encoding="utf-8"))["png_white"]
    return whites
