"""Photos of COLMAP's lens models and pinhole images at the same place: resampling, and the way back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from stages.formats.colmap.model import PINHOLES, read_model, registered
from stages.formats.images.exr import read_exr
from stages.formats.images.masked_photos import read_masked_photo
from stages.formats.images.photo_settings import FireflySettings
from stages.formats.images.photo_turns import read_as_stored
from stages.formats.images.photos import read_mask
from stages.geometry.undistortion import BAND_ROWS, SourceFromTarget, oversampling, resample
from stages.scene.cameras import Camera, pixel_centres, view_name

Lens = dict[str, Any]  # a COLMAP camera as keywords, which a worker can be sent


@dataclass(frozen=True)
class PhotoAndAlbedo:
    """A view's photo and lens, its pinhole camera at working size, and its albedo there.

    Attributes
    ----------
    photo : Path
    name : str
        Of the photo, in its folder.
    as_stored : bool
        Whether the lens is that of the pixels as stored, before the EXIF tag turns them.
    lens : dict
    camera : Camera
    albedo, mask : Path
    """

    photo: Path
    name: str
    as_stored: bool
    lens: Lens
    camera: Camera
    albedo: Path
    mask: Path

    def read(
        self, most_times_bright: float, fireflies: FireflySettings
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Read photo, linear, (H, W, 3), where it can be light, (H, W), albedo, (h, w, 3), and its mask."""
        size = self.lens["width"], self.lens["height"]
        linear, kept, _ = read_masked_photo(
            self.photo, None, size, self.as_stored, False, most_times_bright, fireflies
        )
        return linear, kept, read_exr(self.albedo), read_mask(self.mask)


def photos_and_albedos(inputs: Mapping[str, Path], cameras: Sequence[Camera]) -> list[PhotoAndAlbedo]:
    """Find the photo, lens and maps of every view among a stage's `images`, `model`, `albedo` and `mask`."""
    model = read_model(inputs["model"])
    images = {view_name(image.name): image for image in registered(model)}
    as_stored = read_as_stored(inputs["model"])
    return [
        PhotoAndAlbedo(
            photo=inputs["images"] / image.name,
            name=image.name,
            as_stored=image.name in as_stored,
            lens=lens_of(model.cameras[image.camera_id]),
            camera=camera,
            albedo=inputs["albedo"] / f"{camera.name}.exr",
            mask=inputs["mask"] / f"{camera.name}.png",
        )
        for camera in cameras
        for image in [images[camera.name]]
    ]


def lens_of(camera: pycolmap.Camera) -> Lens:
    """Write a COLMAP camera as keywords."""
    return {
        "model": camera.model_name,
        "width": camera.width,
        "height": camera.height,
        "params": list(camera.params),
    }


def focal_px_of(lens: Lens) -> float:
    """Compute the mean focal length, pixels."""
    return pycolmap.Camera(**lens).mean_focal_length()


def at_photos_size(camera: Camera, lens: Lens) -> Camera:
    """Scale a pinhole camera to the focal length of its photo; never down."""
    finer = max(1.0, focal_px_of(lens) / camera.focal_px)
    return camera.scaled(round(camera.width * finer), round(camera.height * finer))


def through_pinhole(
    linear: np.ndarray, kept: np.ndarray, lens: Lens, camera: Camera
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Resample a photo to a pinhole camera.

    Parameters
    ----------
    linear : ndarray, shape (H, W, 3), float32
    kept : ndarray, shape (H, W), bool
        Pixels that may be used.
    lens : dict
        Of the photo.
    camera : Camera
        The pinhole camera wanted.

    Returns
    -------
    linear : ndarray, shape (h, w, 3), float32
    kept : ndarray, shape (h, w), bool
    touched : bool
        Whether it had to be resampled: not where the photo is that pinhole image already.
    """
    given = pycolmap.Camera(**lens)
    if _same_camera(given, camera):
        return linear, kept, False
    linear, kept = resample(
        linear,
        kept,
        (camera.width, camera.height),
        _source_from_target(given, camera),
        oversampling(given.mean_focal_length(), camera.focal_px),
    )
    return linear, kept, True


def pinhole_from_photo(lens: Lens, camera: Camera) -> np.ndarray:
    """Compute where the pixels of a photo lie in the pinhole image of the same place.

    Returns
    -------
    ndarray, shape (H, W, 2), float32
        Pixels of the pinhole image, centres at 0.5, at any distance outside it; NaN where the lens has no ray
        that a pinhole could see.
    """
    given, K = pycolmap.Camera(**lens), camera.intrinsics
    xy = np.empty((given.height, given.width, 2), np.float32)
    for top in range(0, given.height, BAND_ROWS):
        centres = pixel_centres(given.width, min(BAND_ROWS, given.height - top)) + [0, top]
        rays = np.asarray(given.cam_from_img(centres.reshape(-1, 2)), float)
        xy[top : top + BAND_ROWS] = (rays @ K[:2, :2].T + K[:2, 2]).reshape(centres.shape)
    return xy


def photo_from_pinhole(lens: Lens, camera: Camera) -> np.ndarray:
    """Compute where a pinhole image's pixels lie in the photo: pixels, (h, w, 2); NaN beyond the lens."""
    centres = pixel_centres(camera.width, camera.height)
    source = _source_from_target(pycolmap.Camera(**lens), camera)
    return source(centres.reshape(-1, 2)).reshape(centres.shape)


def _source_from_target(lens: pycolmap.Camera, camera: Camera) -> SourceFromTarget:
    """Find the photo's pixels, (n, 2), behind pixels of the pinhole image; NaN where the lens sees nothing.

    Beyond a fold, where the image of rays farther out turns back, it would be a mirror image of what is
    inside.
    """
    K = camera.intrinsics

    def rays_through(xy: np.ndarray) -> np.ndarray:
        return np.column_stack([(xy - K[:2, 2]) / K.diagonal()[:2], np.ones(len(xy))])

    corners = np.array([[x, y] for x in (0, camera.width) for y in (0, camera.height)], float)
    fold = _fold_of(lens, float(_radius(rays_through(corners)).max()))

    def source(xy: np.ndarray) -> np.ndarray:
        rays = rays_through(xy)
        found = np.asarray(lens.img_from_cam(rays), float)
        found[_radius(rays) > fold] = np.nan
        return found

    return source


def _radius(rays: np.ndarray) -> np.ndarray:
    """Compute the tangent of the angle between rays, (n, 3), z = 1, and the optical axis, (n,)."""
    return np.hypot(rays[:, 0], rays[:, 1])


def _fold_of(lens: pycolmap.Camera, farthest: float) -> float:
    """Find the radius of rays, the tangent of their angle, at which a lens folds; infinite beyond `farthest`.

    Along the axes of the image, in steps of about a pixel.
    """
    radii = np.linspace(0, farthest, max(lens.width, lens.height))
    fold = np.inf
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        xy = np.asarray(lens.img_from_cam(np.stack([x * radii, y * radii, np.ones_like(radii)], axis=1)))
        outwards = np.diff((xy - xy[0]) @ [x, y]) > 0
        if not outwards.all():
            fold = min(fold, float(radii[int(outwards.argmin())]))
    return fold


def _same_camera(lens: pycolmap.Camera, camera: Camera) -> bool:
    """Whether the photo is the pinhole image already, to the bit."""
    return (
        lens.model_name in PINHOLES
        and (lens.width, lens.height) == (camera.width, camera.height)
        and np.array_equal(lens.calibration_matrix(), camera.intrinsics)
    )
