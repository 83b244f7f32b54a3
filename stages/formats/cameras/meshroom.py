"""Meshroom's `cameras.sfm` and `sfm.json` (AliceVision's JSON of scenes)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import UserError
from pipeline.errors import shown
from stages.formats.cameras.documents import damaged, mapping, mappings, number, numbers, pose, whole_size
from stages.formats.cameras.posed_photos import Lens, PosedPhoto, distorted
from stages.scene.poses import inverse

# Versions of the format from which on it is as said.
OFFSETS, TWO_FOCALS, IN_MM, PIXEL_RATIO = (1, 2, 1), (1, 2, 0), (1, 2, 2), (1, 2, 5)
RADIAL = {"none": 0, "pinhole": 0, "radial1": 1, "radialk1": 1, "radial3": 3, "radialk3": 3, "brown": 3}
FISHEYE = ("fisheye", "fisheye4")  # of four coefficients
FIELD_OF_VIEW = "fisheye1"
FILM_MM = 36.0  # width of the sensor where the file does not say

Version = tuple[int, ...]


def posed_photos_of_meshroom(document: Mapping[str, Any], source: Path) -> list[PosedPhoto]:
    """Read the views that have a pose.

    `rotation` lists R of cam_from_world column by column; `center` is the centre of projection.

    Raises
    ------
    UserError
        A field is missing or wrong, a view belongs to a rig, or a lens has no equal among COLMAP's.
    """
    version = tuple(int(one) for one in numbers(document.get("version"), 3, "the version", source))
    lenses = {
        str(one.get("intrinsicId")): one for one in mappings(document.get("intrinsics"), "intrinsics", source)
    }
    poses = {str(one.get("poseId")): one for one in mappings(document.get("poses"), "poses", source)}
    found = []
    for view in mappings(document.get("views"), "views", source):
        placed, lens = poses.get(str(view.get("poseId"))), lenses.get(str(view.get("intrinsicId")))
        if placed is None or lens is None:
            continue
        path = str(view.get("path", ""))
        if "rigId" in view and view.get("isPoseIndependant") in (False, "false", "0"):
            raise UserError(
                f"{source} has {shown(path)} in a rig; expected a pose for each view. Export it without rigs."
            )
        found.append(PosedPhoto(path, _lens(lens, version, source), _pose(placed, path, source)))
    return found


def _pose(entry: Mapping[str, Any], path: str, source: Path) -> np.ndarray:
    transform = mapping(mapping(entry.get("pose"), "a pose", source).get("transform"), "a transform", source)
    world_from_cam = np.reshape(numbers(transform.get("rotation"), 9, "a rotation", source), (3, 3))
    centre = numbers(transform.get("center"), 3, "a center", source)
    return inverse(pose(world_from_cam, centre, path, source))


def _lens(entry: Mapping[str, Any], version: Version, source: Path) -> Lens:
    size = whole_size(entry.get("width"), entry.get("height"), source)
    offset = numbers(entry.get("principalPoint"), 2, "a principalPoint", source)
    middle = (size[0] / 2, size[1] / 2) if version >= OFFSETS else (0.0, 0.0)
    model, distortion = _distortion(entry, source)
    return Lens(
        model,
        distortion,
        size,
        _focal_px(entry, size[0], version, source),
        centre_px=(middle[0] + offset[0], middle[1] + offset[1]),
    )


def _focal_px(entry: Mapping[str, Any], width: int, version: Version, source: Path) -> tuple[float, float]:
    """fx and fy: pixels in older files, later millimetres on the sensor and the ratio of pixels' sides."""
    if version < TWO_FOCALS:
        fx = number(entry.get("pxFocalLength"), "a pxFocalLength", source)
        return fx, fx
    if version < IN_MM:
        fx, fy = numbers(entry.get("pxFocalLength"), 2, "a pxFocalLength", source)
        return fx, fy
    focal_mm = number(entry.get("focalLength"), "a focalLength", source)
    sensor_mm = number(entry.get("sensorWidth", FILM_MM), "a sensorWidth", source)
    ratio = number(entry.get("pixelRatio", 1.0), "a pixelRatio", source)
    if min(focal_mm, sensor_mm, ratio) <= 0:
        raise damaged(source, "a focal length, a sensor or a pixel has no size")
    fx = focal_mm / sensor_mm * width
    return fx, fx * ratio if version >= PIXEL_RATIO else fx / ratio


def _distortion(entry: Mapping[str, Any], source: Path) -> tuple[str, tuple[float, ...]]:
    """COLMAP's model and its distortion; newer files name the kind apart from the projection."""
    kind = str(entry.get("type", "pinhole")).lower()
    if kind == "pinhole":
        kind = str(entry.get("distortionType", kind)).lower()
    listed = entry.get("distortionParams") or []
    given = numbers(listed, len(listed) if isinstance(listed, list) else 0, "distortionParams", source)
    expected = {**RADIAL, "brown": 5, **dict.fromkeys(FISHEYE, 4), FIELD_OF_VIEW: 1}.get(kind)
    if expected is None:
        raise UserError(
            f"{source} has a lens of the type {shown(kind)}; expected pinhole, radial1, radial3, brown, "
            "fisheye4 or fisheye1. Undistort the photos in Meshroom first."
        )
    if len(given) < expected:
        raise damaged(source, f"a lens of the type {kind} has {len(given)} of {expected} coefficients")
    if kind == FIELD_OF_VIEW:
        return "FOV", (given[0],)
    if kind in FISHEYE:
        return distorted((given[0], given[1], given[2], given[3]), (0.0, 0.0), fisheye=True)[:2]
    k1, k2, k3 = (*given[: RADIAL[kind]], 0.0, 0.0, 0.0)[:3]
    tangential = (given[3], given[4]) if kind == "brown" else (0.0, 0.0)
    return distorted((k1, k2, k3, 0.0), tangential)[:2]
