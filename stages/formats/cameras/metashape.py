"""Metashape's XML of cameras (File > Export > Export Cameras)."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from pipeline import UserError
from pipeline.errors import shown
from stages.formats.cameras.documents import damaged, number, numbers, pose, whole_size
from stages.formats.cameras.posed_photos import Lens, PosedPhoto, distorted
from stages.scene.poses import inverse

LOCAL = "LOCAL_CS"  # a reference that is no place on the earth begins so
KINDS = ("frame", "fisheye")
OFF = ("false", "0")


def posed_photos_of_metashape(root: Element, source: Path) -> list[PosedPhoto]:
    """Read the enabled cameras that are aligned, named by their labels.

    A camera's `transform` is chunk from camera, in axes x right, y down, z forward. The world is that of the
    `transform` of the camera's component or of the chunk, scale included, where the chunk has no place on the
    earth; else the chunk's own.

    Raises
    ------
    UserError
        A field is missing or wrong, there are several chunks with cameras, or a lens has no equal among
        COLMAP's.
    """
    chunks = [chunk for chunk in root.iter("chunk") if chunk.find("cameras") is not None]
    if len(chunks) != 1:
        raise UserError(
            f"{source} has {len(chunks)} chunks with cameras; expected one. Export the cameras of one chunk."
        )
    (chunk,) = chunks
    sensors = {sensor.get("id"): sensor for sensor in chunk.iter("sensor")}
    components = {component.get("id"): component for component in chunk.iter("component")}
    lenses: dict[str | None, Lens] = {}
    found = []
    for camera in chunk.iter("camera"):
        placed, sensor_id = camera.find("transform"), camera.get("sensor_id")
        if placed is None or camera.get("enabled", "true").lower() in OFF:
            continue
        if sensor_id not in sensors:
            raise damaged(source, f"a camera has the sensor {shown(sensor_id)}, which is not there")
        if sensor_id not in lenses:
            lenses[sensor_id] = _lens(sensors[sensor_id], source)
        label = camera.get("label", "")
        component = components.get(camera.get("component_id"))
        found.append(PosedPhoto(label, lenses[sensor_id], _pose(placed, chunk, component, label, source)))
    return found


def _pose(placed: Element, chunk: Element, component: Element | None, label: str, source: Path) -> np.ndarray:
    """cam_from_world: rotation and scale of the chunk turn and move the camera, and do not scale its axes."""
    matrix = np.reshape(numbers((placed.text or "").split(), 16, "a transform", source), (4, 4))
    chunk_from_cam = pose(matrix[:3, :3], matrix[:3, 3], label, source)
    rotation, translation, scale = _world_from_chunk(chunk, component, source)
    return inverse(
        pose(
            rotation @ chunk_from_cam[:, :3],
            scale * (rotation @ chunk_from_cam[:, 3]) + translation,
            label,
            source,
        )
    )


def _world_from_chunk(
    chunk: Element, component: Element | None, source: Path
) -> tuple[np.ndarray, np.ndarray, float]:
    """Rotation (3, 3), translation (3,) and scale of a component, in older files of the chunk.

    None where the world would be the earth.
    """
    transform = None if component is None else component.find("transform")
    transform = chunk.find("transform") if transform is None else transform
    reference = chunk.findtext("reference", LOCAL).strip()
    if transform is None or not reference.startswith(LOCAL):
        return np.eye(3), np.zeros(3), 1.0
    rotation = _listed(transform, "rotation", np.eye(3).ravel(), source).reshape(3, 3)
    translation = _listed(transform, "translation", np.zeros(3), source)
    scale = float(_listed(transform, "scale", np.ones(1), source)[0])
    if scale <= 0:
        raise damaged(source, f"the chunk has the scale {scale:g}")
    return pose(rotation, translation, "the chunk", source)[:, :3], translation, scale


def _listed(parent: Element, name: str, otherwise: np.ndarray, source: Path) -> np.ndarray:
    """Numbers of a child; `otherwise` where there is none."""
    text = parent.findtext(name)
    return otherwise if text is None else np.array(numbers(text.split(), len(otherwise), name, source))


def _lens(sensor: Element, source: Path) -> Lens:
    """The lens of a sensor: adjusted rather than initial; cx and cy count from the middle of the image."""
    calibrations = sensor.findall("calibration")
    calibration = next((one for one in calibrations if one.get("class") == "adjusted"), None)
    calibration = calibrations[0] if calibration is None and calibrations else calibration
    kind = sensor.get("type", "frame")
    if kind not in KINDS:
        raise UserError(
            f"{source} has a sensor of the type {shown(kind)}; expected {' or '.join(KINDS)}. Leave its "
            "photos out, or undistort them in Metashape first."
        )
    if calibration is None:
        raise damaged(source, "a sensor of aligned cameras has no calibration")
    return _calibrated(sensor, calibration, kind == "fisheye", source)


def _calibrated(sensor: Element, calibration: Element, fisheye: bool, source: Path) -> Lens:
    resolution = calibration.find("resolution")
    resolution = sensor.find("resolution") if resolution is None else resolution
    if resolution is None:
        raise damaged(source, "a sensor has no resolution")
    width, height = whole_size(resolution.get("width"), resolution.get("height"), source)

    def of(name: str, otherwise: float = 0.0) -> float:
        text = calibration.findtext(name)
        return otherwise if text is None else number(text.strip(), name, source)

    if (of("p3") or of("p4")) and (of("p1") or of("p2")):
        raise UserError(
            f"{source} has a lens with the coefficients p3 and p4; expected p1 and p2 alone. Align "
            "the photos again without them, or undistort the photos in Metashape first."
        )
    fy = of("f", of("fy"))
    fx = of("f", of("fx")) + of("b1")
    # Metashape's p1 goes with r² + 2x², as OpenCV's p2 does.
    model, distortion, r8 = distorted((of("k1"), of("k2"), of("k3"), of("k4")), (of("p2"), of("p1")), fisheye)
    return Lens(
        model,
        distortion,
        (width, height),
        (fx, fy),
        centre_px=(width / 2 + of("cx"), height / 2 + of("cy")),
        r8=r8,
        skew_px=of("b2", of("skew")),
    )
