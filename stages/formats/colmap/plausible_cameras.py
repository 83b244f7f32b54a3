"""Checks of a model's cameras and poses against what lenses can be."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pycolmap

from pipeline import UserError
from stages.scene.cameras import FARTHEST
from stages.scene.poses import UNROUND

# Bounds of what a lens can be. They check input, far outside of what any camera has, and shape no result: a
# model that is refused has to be exported again, whatever the bound. So they are no settings.
SAMPLES = 9  # across and down the image, where a lens is tried
FARTHEST_CENTRE = 4.0  # focal lengths, 76°, from the middle of the image: it may be a crop or a tile
WIDEST, NARROWEST = 11.0, 5e-5  # focal lengths from the middle to a corner: 170° in all, and some 20"
MOST_STRETCHED = 4.0  # what a lens with a rim makes of a distance from its centre, against a pinhole
FAR_OUT = 0.25  # diagonals from the centre, where the drawing out of the image is measured
UNDONE_PX = 1  # a pixel that comes back so near has been undone
LEAST_INVERTIBLE = 0.2  # share of the image; fitted lenses fold in corners that no point was seen in
WIDE = ("FISHEYE", "FOV", "EUCM")  # in their names: a pinhole is no measure of them


def check_cameras(model: pycolmap.Reconstruction, source: Path | str) -> None:
    """Refuse cameras and poses of posed images that are impossible.

    Raises
    ------
    UserError
        A size or focal length is not positive, a parameter not finite, the field of view or the way from
        the principal point to the image is beyond any lens, the lens cannot be undone over most of the image
        or draws it out by more than `MOST_STRETCHED`, or a pose is not finite, beyond `FARTHEST`, no
        rotation, or missing in a rig.
    """
    try:
        images = [model.images[image_id] for image_id in sorted(model.reg_image_ids())]
    except (RuntimeError, ValueError, IndexError, KeyError) as error:
        raise UserError(
            f"The COLMAP model in {source} has poses of images that it does not hold "
            f"({' '.join(str(error).split())[:200]}); it was cut off or damaged. Export it again."
        ) from error
    of_camera = {image.camera_id: image.name for image in reversed(images)}
    for camera_id, name in sorted(of_camera.items()):
        if fault := _fault_of(model.cameras[camera_id]):
            camera = model.cameras[camera_id]
            raise UserError(
                f"Camera {camera_id} in {source}, of {name}, has impossible parameters: {fault} "
                f"({camera.model_name}, {camera.width} × {camera.height}, {camera.params_to_string()}). "
                "Export the cameras again."
            )
    for image in images:
        pose = _pose_of(image, source)
        if not _is_pose(pose):
            raise UserError(
                f"{image.name} in {source} has a pose that is not one (rotation "
                f"{pose.rotation.quat.tolist()}, translation {pose.translation.tolist()}); expected numbers "
                f"below {FARTHEST:g} and a rotation. Export the cameras again."
            )


def _pose_of(image: pycolmap.Image, source: Path | str) -> pycolmap.Rigid3d:
    """Pose of a posed image, which needs that of its camera in its rig."""
    try:
        return image.cam_from_world()
    except RuntimeError as error:
        raise UserError(
            f"{image.name} in {source} has a camera without a pose in its rig; expected one for each camera "
            "of a rig. Calibrate the rig in COLMAP, or leave these images out."
        ) from error


def _is_pose(cam_from_world: pycolmap.Rigid3d) -> bool:
    """Test for a unit quaternion and a translation that single precision can hold.

    COLMAP takes quaternions of any length, whose matrices would scale the scene.
    """
    off = abs(math.hypot(*cam_from_world.rotation.quat) - 1)  # numpy would warn of what overflows
    return bool(off < UNROUND and np.abs(cam_from_world.translation).max() < FARTHEST)  # NaN is neither


def _fault_of(camera: pycolmap.Camera) -> str:
    """What is wrong, in words; empty where nothing is."""
    size = np.array([camera.width, camera.height], float)
    if not np.isfinite(camera.params).all():
        return "they are not all finite"
    if size.min() <= 0:
        return "it has no size"
    focal_px = np.asarray(camera.params)[list(camera.focal_length_idxs())]
    if len(focal_px) and focal_px.min() <= 0:
        return f"a focal length of {focal_px.min():g} px"
    if not len(focal_px) or len(camera.principal_point_idxs()) < 2:
        return ""  # all around: neither has a meaning there
    centre = np.asarray(camera.params)[list(camera.principal_point_idxs())]
    corner = float(np.hypot(*size)) / 2 / float(focal_px.min())
    if not NARROWEST <= corner <= WIDEST:
        return f"a focal length of {focal_px.min():g} px"
    if np.hypot(*(centre - size / 2)) > FARTHEST_CENTRE * focal_px.min() + np.hypot(*size):
        return f"a principal point at {centre[0]:g}, {centre[1]:g} px"
    return _fault_of_lens(camera, centre)


def _fault_of_lens(camera: pycolmap.Camera, centre: np.ndarray) -> str:
    across, down = (np.linspace(0, side, SAMPLES) for side in (camera.width, camera.height))
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    with np.errstate(all="ignore"):
        rays = np.asarray(camera.cam_from_img(pixels), float)
        back = np.asarray(camera.img_from_cam(np.concatenate([rays, np.ones((len(rays), 1))], axis=1)), float)
        undone = np.linalg.norm(back - pixels, axis=1) < UNDONE_PX
        if undone.mean() < LEAST_INVERTIBLE:
            return f"its lens can be undone over {undone.mean():.0%} of the image only"
        if any(word in camera.model_name for word in WIDE):
            return ""
        from_centre = np.linalg.norm(pixels - centre, axis=1)
        ideal = np.linalg.norm(rays * camera.mean_focal_length(), axis=1)
        far = undone & (from_centre > FAR_OUT * np.hypot(camera.width, camera.height))
        stretched = float(np.median(from_centre[far] / ideal[far])) if far.any() else 1.0
    if not 1 / MOST_STRETCHED <= stretched <= MOST_STRETCHED:
        return f"its lens draws the image out by a factor of {stretched:.3g}"
    return ""
