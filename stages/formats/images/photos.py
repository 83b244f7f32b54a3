"""Photographs of any kind, read as linear light; 8- and 16-bit sRGB pictures, written; masks, both ways."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from pipeline import UserError
from stages.formats.colour.icc_profiles import read_profile
from stages.formats.colour.srgb import linear_from_srgb, srgb_from_linear
from stages.formats.decoders.camera_raw import raw_orientation, raw_size, read_raw
from stages.formats.decoders.heif import heif_size, read_heif
from stages.formats.decoders.pictures import (
    decoded_by_opencv,
    opened,
    orientation_in,
    read_encoded,
    turned_back,
    unreadable,
)
from stages.formats.decoders.png_chunks import said_to_be_srgb
from stages.formats.images.exr import check_exr_header, read_exr
from stages.scene.image_names import CAMERA_RAW, HEIF

# Three floats per pixel: 3 GB at this size. Checked from the header, before anything is allocated; Pillow's
# own guard is switched off because it warns at a third of this.
LARGEST_PHOTO_PX = 256_000_000
MOST_PX_PER_BYTE = 10_000  # deflate packs a thousand bytes into one; a bit is a pixel at least
Image.MAX_IMAGE_PIXELS = None


def photo_size(path: Path, as_stored: bool = False) -> tuple[int, int]:
    """Read width and height, px, upright (EXIF orientation applied) or as stored, from the header only.

    Raises
    ------
    UserError
        The file is unreadable, larger than `LARGEST_PHOTO_PX`, or has too few bytes for its pixels.
    """
    bounded, suffix = False, path.suffix.lower()  # EXR, HDR, raw have their own checks
    if suffix == ".exr":
        width, height = check_exr_header(path)
    elif suffix == ".hdr":
        width, height = _hdr_size(path)
    elif suffix in CAMERA_RAW:
        width, height = raw_size(path, as_stored)
    elif suffix in HEIF:
        width, height = heif_size(path)
    else:
        with opened(path) as image:
            width, height = image.size
            bounded = image.format not in ("WEBP", "AVIF")  # of which a hundred bytes may be any size
            upright_already = image.format == "TIFF"  # Pillow reports its size so
            if orientation_in(image, path) >= 5 and upright_already == as_stored:
                width, height = height, width
    if min(width, height) < 1:
        raise unreadable(path, f"it claims to be {width} × {height} pixels")
    if width * height > LARGEST_PHOTO_PX:
        raise UserError(
            f"{path} claims to be {width} × {height} pixels, more than the {LARGEST_PHOTO_PX // 10**6} "
            "megapixels that are accepted; scale it down or remove it."
        )
    size = path.stat().st_size
    if bounded and width * height > MOST_PX_PER_BYTE * size:  # a decoder may fill with black what lacks
        raise unreadable(path, f"it claims to hold {width} × {height} pixels in {size} bytes")
    return width, height


def read_photo(path: Path, as_stored: bool = False) -> np.ndarray:
    """Read a photo as linear RGB, shape (h, w, 3), float32, upright or as stored.

    JPEG, PNG, TIFF, HEIC (8 bits or more; grey, palette, alpha, CMYK) are taken as sRGB, or as an embedded
    profile of curves and a matrix says; alpha is dropped. EXR and HDR are linear already and come as they
    are. Camera raw is developed without a curve: see `read_raw`. What is passed over:
    `photo_remarks.remarks_on`.

    Raises
    ------
    UserError
        The file is truncated, unreadable, of an unknown kind or too large.
    """
    photo_size(path)
    suffix = path.suffix.lower()
    if suffix == ".exr":
        linear = read_exr(path)
    elif suffix == ".hdr":
        linear = decoded_by_opencv(path, path.read_bytes())
    elif suffix in CAMERA_RAW:
        return read_raw(path, as_stored)
    else:
        encoded, profile = read_heif(path) if suffix in HEIF else read_encoded(path)
        encoded = encoded[..., :3] if encoded.ndim == 3 else encoded
        known = read_profile(profile) if profile else None
        linear = _linear_table(encoded.dtype.name)[encoded] if known is None else known.linear(encoded)
    if linear.ndim == 2:
        linear = np.repeat(linear[..., None], 3, axis=-1)
    if as_stored:
        linear = turned_back(linear, orientation_of(path))
    return np.ascontiguousarray(linear[..., :3], np.float32)


def read_environment(path: Path) -> np.ndarray:
    """Read a picture of all directions, shape (h, 2h, 3), linear.

    Raises
    ------
    UserError
        It is neither EXR nor HDR, cannot be read, is not twice as wide as high, or holds no light, or some
        that is negative or no number.
    """
    if path.suffix.lower() not in (".exr", ".hdr"):
        raise UserError(
            f"{path} is no picture of light; expected EXR or HDR: in eight bits a sun is no brighter than "
            "a cloud."
        )
    picture = read_photo(path)
    height, width = picture.shape[:2]
    if width != 2 * height:
        raise UserError(
            f"{path} has {width} × {height} pixels; expected a picture of all directions, twice as "
            "wide as high (equirectangular, EXR or HDR)."
        )
    if not np.isfinite(picture).all() or picture.min() < 0:
        raise UserError(f"{path} holds values that are negative or not numbers; expected radiance.")
    if not picture.any():
        raise UserError(f"{path} is black; expected light from somewhere.")
    return picture


def read_mask(path: Path, as_stored: bool = False) -> np.ndarray:
    """Read a mask, shape (h, w), bool: True where it is white (at least half), upright or as stored."""
    photo_size(path)
    values, _ = read_encoded(path)
    if as_stored:
        values = turned_back(values, orientation_of(path))
    brightest = values
    if values.ndim == 3:  # by twos: a reduction over so short an axis takes seven times as long
        brightest = np.maximum(np.maximum(values[..., 0], values[..., 1]), values[..., 2])
    return brightest > np.iinfo(values.dtype).max // 2


def write_mask(path: Path, mask: np.ndarray) -> None:
    """Write a boolean mask, shape (h, w), as 8-bit PNG, white = True, creating the folder."""
    _write_png(path, np.where(mask, 255, 0).astype(np.uint8))


def encode_srgb8(linear: np.ndarray) -> np.ndarray:
    """Encode linear light, any shape, as 8-bit sRGB, uint8; clipped to [0, 1] first."""
    return np.rint(srgb_from_linear(linear) * np.float32(255)).astype(np.uint8)


def encode_srgb16(linear: np.ndarray) -> np.ndarray:
    """Encode linear light, any shape, as 16-bit sRGB, uint16; clipped to [0, 1] first."""
    return np.rint(srgb_from_linear(linear) * np.float32(65535)).astype(np.uint16)


def write_png_srgb8(path: Path, linear: np.ndarray) -> None:
    """Write linear light, (h, w, 3) or (h, w), as an 8-bit sRGB PNG, creating the folder."""
    _write_png(path, encode_srgb8(linear), is_srgb=True)


def write_png_srgb16(path: Path, linear: np.ndarray) -> None:
    """Write linear light, (h, w, 3) or (h, w), as a 16-bit sRGB PNG, creating the folder."""
    _write_png(path, encode_srgb16(linear), is_srgb=True)


def write_png8(path: Path, pixels: np.ndarray) -> None:
    """Write 8-bit values as they are, uint8, (h, w, 3) RGB or (h, w), as PNG, creating the folder."""
    _write_png(path, pixels)


def orientation_of(path: Path) -> int:
    """Read the orientation that the header gives, 1 to 8; 1, upright as stored, where it gives none.

    Raises
    ------
    UserError
        The file is unreadable.
    """
    if path.suffix.lower() in (".exr", ".hdr", *HEIF):  # libheif turns pictures by itself
        return 1
    if path.suffix.lower() in CAMERA_RAW:
        return raw_orientation(path)
    with opened(path) as image:
        return orientation_in(image, path)


def _hdr_size(path: Path) -> tuple[int, int]:
    """Size from the line of a Radiance file behind the first blank one (``-Y height +X width``)."""
    try:
        with path.open("rb") as file:
            _, _, rest = file.read(65536).partition(b"\n\n")
        words = rest.partition(b"\n")[0].split()
        if len(words) == 4 and words[0] in (b"-Y", b"+Y"):
            return int(words[3]), int(words[1])
    except (OSError, ValueError) as error:
        raise unreadable(path, error) from error
    raise unreadable(path, "no size in its header")


@cache
def _linear_table(dtype: str) -> np.ndarray:
    """Linear light of every code value of uint8 or uint16."""
    codes = np.arange(np.iinfo(dtype).max + 1)
    return linear_from_srgb(codes / codes[-1])


def _write_png(path: Path, pixels: np.ndarray, is_srgb: bool = False) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    ordered = np.ascontiguousarray(pixels[..., ::-1]) if pixels.ndim == 3 else pixels
    _, data = cv2.imencode(".png", ordered)
    path.write_bytes(said_to_be_srgb(data.tobytes()) if is_srgb else data.tobytes())
