"""`transforms.json` of nerfstudio, instant-ngp and Blender's NeRF exporters: read and written."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import UserError, json_text
from pipeline.errors import shown
from stages.formats.cameras.documents import damaged, mappings, number, numbers, pose, whole_size
from stages.formats.cameras.posed_photos import Lens, PosedPhoto, distorted
from stages.scene.cameras import Camera
from stages.scene.poses import inverse, with_flipped_camera_axes

PERSPECTIVE = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
FISHEYE = "OPENCV_FISHEYE"
RADIAL, TANGENTIAL, RATIONAL = ("k1", "k2", "k3", "k4"), ("p1", "p2"), ("k5", "k6")


def posed_photos_of_transforms(document: Mapping[str, Any], source: Path) -> list[PosedPhoto]:
    """Read the frames: `transform_matrix` is world from camera, in OpenGL's axes of the camera.

    The world is that of these matrices: `applied_transform`, which led to it, is not undone.

    Raises
    ------
    UserError
        A field is missing or wrong, or the camera has no equal among COLMAP's.
    """
    found = []
    for frame in mappings(document.get("frames"), "frames", source):
        path = frame.get("file_path")
        if not isinstance(path, str):
            raise damaged(source, f"a frame has the file_path {shown(path)}, expected a text")
        found.append(PosedPhoto(path, _lens({**document, **frame}, source), _pose(frame, path, source)))
    return found


def _pose(frame: Mapping[str, Any], path: str, source: Path) -> np.ndarray:
    """cam_from_world of a frame; a fourth row is passed over."""
    what, rows = f"the transform_matrix of {path}", frame.get("transform_matrix")
    if not isinstance(rows, list) or len(rows) not in (3, 4):
        raise damaged(source, f"{what} is {shown(rows)}, expected 4 × 4 numbers")
    matrix = np.array([numbers(row, 4, what, source) for row in rows[:3]])
    world_from_cam = pose(matrix[:, :3], matrix[:, 3], path, source)
    return with_flipped_camera_axes(inverse(world_from_cam))


def _lens(fields: Mapping[str, Any], source: Path) -> Lens:
    """The lens of a frame, from its own fields or those of all."""
    model = fields.get("camera_model", FISHEYE if fields.get("is_fisheye") is True else "OPENCV")
    if model not in (*PERSPECTIVE, FISHEYE):
        raise UserError(
            f"{source} has the camera_model {shown(model)}; expected {', '.join(PERSPECTIVE)} or {FISHEYE}. "
            "Undistort the photos into pinhole images first."
        )
    given = {name: number(fields[name], name, source) for name in _NUMBERS if name in fields}
    if any(given.get(name) for name in RATIONAL):
        raise UserError(f"{source} has the coefficients k5 and k6; expected k1 to k4, p1 and p2.")
    k1, k2, k3, k4 = (given.get(name, 0.0) for name in RADIAL)
    tangential = (given.get("p1", 0.0), given.get("p2", 0.0))
    name, distortion, r8 = distorted((k1, k2, k3, k4), tangential, model == FISHEYE)
    focal = (given["fl_x"], given.get("fl_y", given["fl_x"])) if "fl_x" in given else None
    if focal is None and not 0 < given.get("camera_angle_x", 0) < math.pi:
        raise damaged(source, "a frame has neither fl_x nor a camera_angle_x between 0 and π")
    if focal is None and not 0 < given.get("camera_angle_y", 1) < math.pi:
        raise damaged(source, "a frame has a camera_angle_y that is not between 0 and π")
    size = whole_size(fields["w"], fields["h"], source) if "w" in fields and "h" in fields else None
    return Lens(
        name,
        distortion,
        size,
        focal,
        (given.get("camera_angle_x", math.nan), given.get("camera_angle_y", math.nan)),
        (given["cx"], given["cy"]) if "cx" in given and "cy" in given else None,
        r8,
    )


_NUMBERS = (
    *("fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y"),
    *(*RADIAL, *TANGENTIAL, *RATIONAL),
)


def write_transforms(path: Path, cameras: Sequence[Camera], photos: str, masks: str) -> None:
    """Write pinhole cameras as a `transforms.json` of nerfstudio; the world stays as it is.

    Parameters
    ----------
    path : Path
    cameras : sequence of Camera
    photos, masks : str
        Paths of a view's photo and mask, relative to `path`, with ``{name}`` for the view.
    """
    frames = [
        {
            "file_path": photos.format(name=camera.name),
            "mask_path": masks.format(name=camera.name),
            **_intrinsics(camera),
            "transform_matrix": [*_world_from_cam(camera).tolist(), [0.0, 0.0, 0.0, 1.0]],
        }
        for camera in cameras
    ]
    document = {"camera_model": "PINHOLE", "frames": frames}
    path.write_text(json_text(document, indent=1) + "\n", encoding="utf-8")


def _intrinsics(camera: Camera) -> dict[str, float]:
    K = camera.intrinsics
    return {
        "w": camera.width,
        "h": camera.height,
        "fl_x": float(K[0, 0]),
        "fl_y": float(K[1, 1]),
        "cx": float(K[0, 2]),
        "cy": float(K[1, 2]),
    }


def _world_from_cam(camera: Camera) -> np.ndarray:
    """World from camera, (3, 4), in OpenGL's axes of the camera."""
    return inverse(with_flipped_camera_axes(camera.cam_from_world))
