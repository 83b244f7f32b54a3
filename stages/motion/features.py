"""SIFT features of photos: on 8-bit copies of bounded size, in coordinates of the full photo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pycolmap

from stages.formats.images.photos import encode_srgb8, read_photo, write_mask, write_png_srgb8
from stages.motion.room import check_room, room_for_features


@dataclass(frozen=True)
class Features:
    """SIFT features of one photo.

    Attributes
    ----------
    keypoints : ndarray, shape (n, 6), float32
        x, y in pixels of the full upright photo (first centre at 0.5), then COLMAP's 2×2 shape, row by row.
    descriptors : ndarray, shape (n, 128), uint8
    colours : ndarray, shape (n, 3), uint8
        sRGB of the photo there.
    """

    keypoints: np.ndarray
    descriptors: np.ndarray
    colours: np.ndarray


def write_reduced(linear: np.ndarray, path: Path, max_size_px: int) -> None:
    """Write the copy of a photo that COLMAP reads: 8-bit sRGB PNG, longest side at most `max_size_px`.

    COLMAP knows neither 16 bits, EXIF rotation nor linear light; and it would reduce in sRGB.
    """
    height, width = linear.shape[:2]
    size = size_of_copy(width, height, max_size_px)
    if size != (width, height):
        linear = cv2.resize(linear, size, interpolation=cv2.INTER_AREA)
    write_png_srgb8(path, linear)


def size_of_copy(width: int, height: int, max_size_px: int) -> tuple[int, int]:
    """Compute width and height of the reduced copy of a photo."""
    reduction = min(1.0, max_size_px / max(width, height))
    return max(1, round(width * reduction)), max(1, round(height * reduction))


def write_reduced_mask(kept: np.ndarray, copy: Path, masks: Path, max_size_px: int) -> None:
    """Write the mask of a reduced copy where COLMAP seeks it: in the folder `masks`, the name with ``.png``.

    Parameters
    ----------
    kept : ndarray, shape (h, w), bool
        Pixels of the full photo in which features may lie.
    copy : Path
        The reduced copy, which may not be there yet.
    masks : Path
    max_size_px : int
        That of the copy.
    """
    size = size_of_copy(kept.shape[1], kept.shape[0], max_size_px)
    rounded = cv2.resize(kept.astype(np.uint8), size, interpolation=cv2.INTER_AREA)
    write_mask(masks / f"{copy.name}.png", rounded > 0)


def detect(
    copies: Sequence[Path], database: Path, max_features: int, threads: int, masks: Path | None = None
) -> None:
    """Detect and describe SIFT features of some reduced copies (of one folder) into a scratch database.

    Features outside of the `masks`, of `write_reduced_mask`, are dropped, after the `max_features` largest
    of the whole copy were chosen; COLMAP passes over a copy without a mask. The rows' order follows the
    threads: only `read_features`, by name, makes sense of it. Raises what `check_room` does.
    """
    check_room(database, room_for_features([max_features] * len(copies)))
    options = pycolmap.FeatureExtractionOptions(num_threads=threads, use_gpu=False)
    options.sift.max_num_features = max_features
    reading = pycolmap.ImageReaderOptions() if masks is None else pycolmap.ImageReaderOptions(mask_path=masks)
    pycolmap.extract_features(
        database,
        copies[0].parent,
        image_names=[copy.name for copy in copies],
        camera_mode=pycolmap.CameraMode.PER_IMAGE,
        reader_options=reading,
        extraction_options=options,
        device=pycolmap.Device.cpu,
    )


def read_features(database: pycolmap.Database, copy: Path, width: int, height: int) -> Features:
    """Read features of one reduced copy, scaled to the full photo of `width` × `height` pixels."""
    image = database.read_image_with_name(copy.name)
    if image is None:
        raise LookupError(f"no features were sought in {copy.name}")
    small = encode_srgb8(read_photo(copy))
    keypoints = database.read_keypoints(image.image_id)
    return Features(
        keypoints=in_full_photo(keypoints, width / small.shape[1], height / small.shape[0]),
        descriptors=np.asarray(database.read_descriptors(image.image_id).data, np.uint8).reshape(-1, 128),
        colours=_colours_at(small, keypoints),
    )


def in_full_photo(keypoints: np.ndarray, scale_x: float, scale_y: float) -> np.ndarray:
    """Scale keypoints (n, 6) of a reduced copy to the full photo: a product, for centres are at 0.5."""
    return keypoints * np.array([scale_x, scale_y, scale_x, scale_x, scale_y, scale_y], np.float32)


def _colours_at(image: np.ndarray, keypoints: np.ndarray) -> np.ndarray:
    column = np.clip(keypoints[:, 0].astype(int), 0, image.shape[1] - 1)
    row = np.clip(keypoints[:, 1].astype(int), 0, image.shape[0] - 1)
    return image[row, column]
