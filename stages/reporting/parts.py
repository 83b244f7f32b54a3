"""The folder of the report's content: pictures and `content.json`, from which the page is put together."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pipeline import json_text

CONTENT, SURFACE = "content.json", "surface.bin"
THUMBNAILS = ("photo", "albedo")  # kinds of the small pictures that choose a view
TEXTURES = ("albedo", "photo", "shading", "confidence", "relief")  # kinds of a texture's pictures
KINDS = {  # of pictures, in their order, and what each shows
    "photo": "the photo, undistorted",
    "albedo": "what the surface reflects, without light and shading",
    "shading": "the light that reaches the surface: photo ≈ albedo × shading",
    "normal": "orientation of the surface: x, y, z of the world as red, green, blue",
    "depth": "distance from the camera: yellow is near, violet is far",
    "confidence": "certainty of the albedo: white is certain, black is inferred from elsewhere",
    "residual": "what albedo × shading leaves: grey nothing, orange brighter, blue darker than explained",
    "relit": "the albedo under another light",
}


def picture_file(view: int, kind: str) -> str:
    """Name the file of a view's picture, by the view's number: names of photos are whatever people chose."""
    return f"pictures/{view:04d}-{kind}.webp"


def thumbnail_file(view: int, kind: str) -> str:
    """Name the file of a view's small picture, of one of the `THUMBNAILS`."""
    return f"pictures/{view:04d}-{kind}-small.webp"


def texture_file(number: int, kind: str) -> str:
    """Name the file of a picture of a texture, by its number and what it shows."""
    return f"textures/{number:04d}-{kind}.webp"


def light_file(number: int, what: str) -> str:
    """Name the file of a picture of light: `environment` or `ball`."""
    return f"light/{number:04d}-{what}.webp"


def write_file(folder: Path, name: str, data: bytes) -> None:
    """Write a file, creating its folder."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def write_content(folder: Path, content: dict[str, Any]) -> None:
    """Write `content.json`."""
    (folder / CONTENT).write_text(json_text(content, indent=1) + "\n", encoding="utf-8")


def read_content(folder: Path) -> dict[str, Any]:
    """Read `content.json`."""
    return json.loads((folder / CONTENT).read_text(encoding="utf-8"))
