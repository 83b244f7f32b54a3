"""`cameras.json`: the pinhole cameras of the views that are being decomposed, at their size."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from pipeline import json_text
from stages.scene.cameras import Camera


def write_cameras(path: Path, cameras: list[Camera]) -> None:
    """Write the cameras, in order, as JSON (conventions: CONVENTIONS.md)."""
    rows = [
        {
            "name": camera.name,
            "width": camera.width,
            "height": camera.height,
            "intrinsics": camera.intrinsics.tolist(),
            "cam_from_world": camera.cam_from_world.tolist(),
        }
        for camera in cameras
    ]
    path.write_text(json_text(rows, indent=1) + "\n", encoding="utf-8")


def read_cameras(path: Path) -> list[Camera]:
    """Read what `write_cameras` wrote."""
    return [
        Camera(
            name=row["name"],
            width=row["width"],
            height=row["height"],
            intrinsics=np.array(row["intrinsics"], float),
            cam_from_world=np.array(row["cam_from_world"], float),
        )
        for row in json.loads(path.read_text(encoding="utf-8"))
    ]
