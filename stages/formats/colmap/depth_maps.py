"""COLMAP's depth and normal maps (``*.geometric.bin``), read and written.

A text header ``width&height&channels&``, then float32, little-endian, column fastest, then row, then
channel: what COLMAP's ``read_array`` in ``read_write_dense.py`` reads. Depth is z, 0 where unknown; normals
are in **camera axes** (the crossing is `cameras.normals_in_cam`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline import UserError

LONGEST_HEADER = 64  # bytes; three decimal numbers and three ampersands are far shorter


def write_map(path: Path, values: np.ndarray) -> None:
    """Write a depth map (h, w) or a normal map (h, w, 3) as float32, creating the folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    planar = values[None] if values.ndim == 2 else np.moveaxis(values, -1, 0)
    channels, height, width = planar.shape
    header = f"{width}&{height}&{channels}&".encode("ascii")
    path.write_bytes(header + np.ascontiguousarray(planar, "<f4").tobytes())


def check_map(path: Path) -> tuple[int, int, int]:
    """Check header and length of a map; returns its width, height, and number of channels.

    Raises
    ------
    UserError
        The header is not COLMAP's, or the file's length is not what the header says.
    """
    with path.open("rb") as file:
        fields = file.read(LONGEST_HEADER).split(b"&", 3)
    if len(fields) < 4 or not all(field.isdigit() and int(field) > 0 for field in fields[:3]):
        raise UserError(
            f"{path} does not begin with 'width&height&channels&': it is no COLMAP depth or normal map."
        )
    width, height, channels = (int(field) for field in fields[:3])
    held = path.stat().st_size - sum(len(field) + 1 for field in fields[:3])
    if held != 4 * width * height * channels:
        raise UserError(
            f"{path} holds {held} bytes after its header; expected "
            f"{4 * width * height * channels} for {width}×{height}×{channels} float32. "
            "It was cut off: compute or copy it again."
        )
    return width, height, channels


def read_map(path: Path) -> np.ndarray:
    """Read a depth map as (h, w), a normal map as (h, w, 3), float32.

    Raises
    ------
    UserError
        As `check_map`.
    """
    width, height, channels = check_map(path)
    held = 4 * width * height * channels
    values = np.fromfile(path, "<f4", offset=path.stat().st_size - held).reshape(channels, height, width)
    values = values.astype(np.float32, copy=False)
    return values[0] if channels == 1 else np.ascontiguousarray(np.moveaxis(values, 0, -1))
