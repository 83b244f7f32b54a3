"""A photo as a pinhole camera at the same place would have taken it, in linear light."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from pipeline import UserError
from stages.geometry.undistortion import oversampling, resample
from stages.scene.cameras import Camera
from stages.scene.colmap_model import PINHOLES
from stages.scene.photos import read_mask, read_photo


@dataclass(frozen=True)
class Photo:
    """A photo and its lens, in values that a worker can be sent.

    Attributes
    ----------
    image, mask : Path
        The mask may be missing.
    lens : dict
        COLMAP camera of the photo, as keywords.
    """

    image: Path
    mask: Path | None
    lens: dict[str, Any]

    @property
    def focal_px(self) -> float:
        """Mean focal length of its lens."""
        return pycolmap.Camera(**self.lens).mean_focal_length()


def lens_of(camera: pycolmap.Camera) -> dict[str, Any]:
    """A COLMAP camera as keywords."""
    return {
        "model": camera.model_name,
        "width": camera.width,
        "height": camera.height,
        "params": list(camera.params),
    }


def pinhole_photo(photo: Photo, camera: Camera) -> tuple[np.ndarray, np.ndarray, bool]:
    """Resample a photo to a pinhole camera.

    Returns
    -------
    linear : ndarray, shape (h, w, 3), float32
    kept : ndarray, shape (h, w), bool
        Inside the photo, finite, and white in its mask.
    touched : bool
        Whether it had to be resampled: not where the photo is that pinhole image already.

    Raises
    ------
    UserError
        Photo, mask and lens differ in size.
    """
    linear, lens = read_photo(photo.image), pycolmap.Camera(**photo.lens)
    height, width = linear.shape[:2]
    if (width, height) != (lens.width, lens.height):
        raise UserError(
            f"{photo.image} is {width} × {height} pixels, but its camera in the model is {lens.width} × "
            f"{lens.height}; give the photos that the model was made from."
        )
    kept = np.ones((height, width), bool)
    if photo.mask is not None:
        kept = read_mask(photo.mask)
        if kept.shape != (height, width):
            raise UserError(
                f"The mask {photo.mask} is {kept.shape[1]} × {kept.shape[0]} pixels, its photo {width} × "
                f"{height}; masks must have their photo's size."
            )
    finite = np.isfinite(linear).all(axis=2)  # renderers and merging tools leave NaN and infinity behind
    if not finite.all():
        linear, kept = np.where(finite[..., None], linear, np.float32(0)), kept & finite
    if _same_camera(lens, camera):
        return linear, kept, False
    linear, kept = resample(
        linear,
        kept,
        (camera.width, camera.height),
        lambda xy: _source_from_target(lens, camera, xy),
        oversampling(lens.mean_focal_length(), camera.focal_px),
    )
    return linear, kept, True


def _source_from_target(lens: pycolmap.Camera, camera: Camera, xy: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of the photo behind pixels of the pinhole image; NaN where the lens sees nothing."""
    K = camera.intrinsics
    rays = np.ones((len(xy), 3))
    rays[:, 0] = (xy[:, 0] - K[0, 2]) / K[0, 0]
    rays[:, 1] = (xy[:, 1] - K[1, 2]) / K[1, 1]
    return lens.img_from_cam(rays)


def _same_camera(lens: pycolmap.Camera, camera: Camera) -> bool:
    """Whether the photo is the pinhole image already, to the bit."""
    return (
        lens.model_name in PINHOLES
        and (lens.width, lens.height) == (camera.width, camera.height)
        and np.array_equal(lens.calibration_matrix(), camera.intrinsics)
    )
