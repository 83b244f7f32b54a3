"""Cameras and poses that no photo was taken with, found before they spread."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap

from pipeline import UserError

SAMPLES = 9  # across and down the image, where a lens is tried
FARTHEST_CENTRE = 1.0  # image sizes beyond the border; crops and shift lenses stay far within
MOST_STRETCHED = 4.0  # what a lens with a rim makes of a distance from its centre, against a pinhole
LEAST_INVERTIBLE = 0.5  # share of the image; fitted lenses often fold in a corner that no point was seen in
WIDE = ("FISHEYE", "EQUIRECTANGULAR", "FOV", "EUCM")  # in their names: a pinhole is no measure of them


def check_cameras(model: pycolmap.Reconstruction, source: Path | str) -> None:
    """Refuse cameras and poses of posed images that are impossible.

    Raises
    ------
    UserError
        A size or focal length is not positive, a parameter not finite, the principal point lies more than
        an image away from the image, the lens cannot be undone over half of it or draws it out by more than
        `MOST_STRETCHED`, or a pose is not finite or has no rotation.
    """
    images = [model.images[image_id] for image_id in sorted(model.reg_image_ids())]
    for camera_id in sorted({image.camera_id for image in images}):
        if fault := _fault_of(model.cameras[camera_id]):
            camera = model.cameras[camera_id]
            raise UserError(
                f"Camera {camera_id} of the COLMAP model in {source} has impossible parameters: {fault} "
                f"({camera.model_name}, {camera.width} × {camera.height}, {camera.params_to_string()}). "
                "Export the model again."
            )
    for image in images:
        pose = image.cam_from_world()
        if not np.isfinite(pose.matrix()).all() or not np.linalg.norm(pose.rotation.quat) > 0:
            raise UserError(
                f"{image.name} in the COLMAP model in {source} has a pose that is not one (rotation "
                f"{pose.rotation.quat.tolist()}, translation {pose.translation.tolist()}); expected finite "
                "numbers and a rotation. Export the model again."
            )


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
    centre = np.array([camera.principal_point_x, camera.principal_point_y])
    if (centre < -FARTHEST_CENTRE * size).any() or (centre > (1 + FARTHEST_CENTRE) * size).any():
        return f"a principal point at {centre[0]:g}, {centre[1]:g} px"
    return _fault_of_lens(camera, centre)


def _fault_of_lens(camera: pycolmap.Camera, centre: np.ndarray) -> str:
    if any(word in camera.model_name for word in WIDE):
        return ""
    across, down = (np.linspace(0, side, SAMPLES) for side in (camera.width, camera.height))
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    with np.errstate(all="ignore"):
        rays = np.asarray(camera.cam_from_img(pixels), float)
        back = np.asarray(camera.img_from_cam(np.concatenate([rays, np.ones((len(rays), 1))], axis=1)), float)
        undone = np.linalg.norm(back - pixels, axis=1) < 1
        if undone.mean() < LEAST_INVERTIBLE:
            return f"its lens can be undone over {undone.mean():.0%} of the image only"
        from_centre = np.linalg.norm(pixels - centre, axis=1)
        ideal = np.linalg.norm(rays * camera.mean_focal_length(), axis=1)
        far = undone & (from_centre > 0.25 * np.hypot(camera.width, camera.height))
        stretched = float(np.median(from_centre[far] / ideal[far])) if far.any() else 1.0
    if not 1 / MOST_STRETCHED <= stretched <= MOST_STRETCHED:
        return f"its lens draws the image out by a factor of {stretched:.3g}"
    return ""
