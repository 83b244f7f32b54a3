"""Pictures decoded: Pillow opens, measures and checks files, OpenCV decodes what Pillow would cut to 8 bits.

Decoding always works on bytes: OpenCV's own file access fails on some paths.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError
from PIL.TiffImagePlugin import TiffImageFile

from pipeline import UserError
from stages.formats.decoders.heif import heif_exif
from stages.formats.decoders.png_chunks import chunks_before_pixels, fault_of_chunks
from stages.scene.image_names import HEIF

# What Pillow raises on damaged files; it warns about damaged EXIF, which strict callers turn into an error.
DECODING_FAILED = (
    *(OSError, SyntaxError, ValueError, EOFError, LookupError, TypeError, ArithmeticError, MemoryError),
    *(struct.error, UserWarning, RuntimeError),  # the last by AVIF's decoder
)

# Pillow knows some fifty kinds by their first bytes, whatever the name says; one runs Ghostscript.
DECODED = ("JPEG", "PNG", "TIFF", "WEBP", "AVIF", "BMP", "GIF")

EXIF_ORIENTATION = 0x0112
EXIF_DIRECTORIES = (0x8769, 0x8825)  # how the photo was taken, and where
TIFF_BITS_PER_SAMPLE = 258
TIFF_SAMPLE_FORMAT = 339
TIFF_PHOTOMETRIC = 262
TIFF_RGB = 2
TIFF_SAMPLES_PER_PIXEL = 277
TIFF_PLANAR = 284
TIFF_APART = 2  # the channels one after another
TIFF_DEEP = (1, TIFF_RGB)  # what OpenCV decodes at 16 bits: grey whose 0 is black, and RGB
TIFF_BITS = (1, 2, 4, 8, 16)


def read_encoded(path: Path) -> tuple[np.ndarray, bytes]:
    """Upright values as stored, uint8 or uint16, (h, w, 3) or (h, w), RGB; and the profile, or nothing."""
    with opened(path) as image:
        deep, profile = _is_16_bit(image, path), _profile_of(image, path)
        orientation = 1 if image.format == "TIFF" else orientation_in(image, path)
        try:
            image.load()  # Pillow alone notices truncation; its TIFF reader turns the image upright here
            if not deep:
                return upright(np.asarray(image.convert("RGB")), orientation), profile
        except DECODING_FAILED as error:
            raise unreadable(path, error) from error
        if image.format == "TIFF":  # OpenCV's reader turns TIFF upright by itself, too
            orientation = 1
    return upright(decoded_by_opencv(path, path.read_bytes()), orientation), profile


def _profile_of(image: Image.Image, path: Path) -> bytes:
    """Read the embedded ICC profile; nothing without, or where a PNG's coding (cICP) comes before it."""
    profile = image.info.get("icc_profile") or b""
    return b"" if profile and b"cICP" in chunks_before_pixels(path) else bytes(profile)


def upright(image: np.ndarray, orientation: int) -> np.ndarray:
    """Undo an EXIF orientation (1 to 8; anything else counts as 1), shape (h, w[, c])."""
    if 5 <= orientation <= 8:
        image = image.swapaxes(0, 1)
    flip_rows = orientation in (3, 4, 7, 8)
    flip_columns = orientation in (2, 3, 6, 7)
    return image[:: -1 if flip_rows else 1, :: -1 if flip_columns else 1]


def upright_places(xy: np.ndarray, size: tuple[int, int], orientation: int) -> np.ndarray:
    """Move places, (…, 2), pixels, from an image as stored, of this width and height, to the upright one."""
    width, height = size
    x, y = xy[..., 0], xy[..., 1]
    if 5 <= orientation <= 8:
        x, y, width, height = y, x, height, width
    if orientation in (3, 4, 7, 8):
        y = height - y
    if orientation in (2, 3, 6, 7):
        x = width - x
    return np.stack([x, y], axis=-1)


def turned_back(image: np.ndarray, orientation: int) -> np.ndarray:
    """As stored, from upright: quarter turns are undone by each other, all else by itself."""
    return upright(image, {6: 8, 8: 6}.get(orientation, orientation))


@contextmanager
def opened(path: Path) -> Iterator[Image.Image]:
    """Open a photo by Pillow, from a file that is open.

    By its name, Pillow maps plain TIFFs into memory, and reads those that are turned by 90° in rows of the
    wrong length.

    Raises
    ------
    UserError
        It is no image, or its header is damaged.
    """
    try:
        file = path.open("rb")
    except OSError as error:
        raise unreadable(path, error) from error
    with file:
        try:
            image = Image.open(file, formats=DECODED)
        except UnidentifiedImageError as error:
            raise unreadable(path, "not an image, or cut off in its header") from error
        except DECODING_FAILED as error:
            raise unreadable(path, error) from error
        yield image


def exif_of(path: Path) -> Image.Exif:
    """Read a photo's EXIF data; empty where it has none, or none that can be read."""
    try:
        if path.suffix.lower() in HEIF:
            exif = Image.Exif()
            exif.load(heif_exif(path))
            return exif
        with Image.open(path) as image:
            exif = Image.Image.getexif(image)
            for directory in EXIF_DIRECTORIES:  # while the file is open: of TIFF they are read on demand
                exif_directory(exif, directory)
            return exif
    except (UserError, Image.DecompressionBombError, *DECODING_FAILED):
        return Image.Exif()


def exif_directory(exif: Image.Exif, directory: int) -> dict[int, Any]:
    """Read one of the directories of EXIF data, `EXIF_DIRECTORIES`; empty where it cannot be read."""
    try:
        return dict(exif.get_ifd(directory))
    except (AttributeError, *DECODING_FAILED):  # of what lies beyond data that were cut off
        return {}


def orientation_in(image: Image.Image, path: Path) -> int:
    """EXIF orientation, 1 to 8, from the header; whatever else stands there (text, x/0) counts as 1.

    Pillow's own `getexif` would decode a whole PNG in search of it.
    """
    try:
        value = Image.Image.getexif(image).get(EXIF_ORIENTATION, 1)
    except DECODING_FAILED as error:
        raise unreadable(path, error) from error
    return int(value) if value in range(1, 9) else 1


def _is_16_bit(image: Image.Image, path: Path) -> bool:
    """Whether the file holds 16 bits per channel, which Pillow would cut to 8 for colour."""
    if image.format == "PNG":
        with path.open("rb") as file:
            return file.read(25)[24] == 16  # bit depth, the ninth byte of IHDR
    if isinstance(image, TiffImageFile):
        _check_tiff(image, path)
        return int(np.atleast_1d(image.tag_v2.get(TIFF_BITS_PER_SAMPLE, 8))[0]) == 16
    return False


def _check_tiff(image: TiffImageFile, path: Path) -> None:
    """Refuse a TIFF whose values no decoder here brings to light as they are meant."""
    if any(code == 3 for code in np.atleast_1d(image.tag_v2.get(TIFF_SAMPLE_FORMAT, 1))):
        raise UserError(
            f"{path} is a floating-point TIFF, which says nothing about its light; export it as EXR."
        )
    bits = int(np.atleast_1d(image.tag_v2.get(TIFF_BITS_PER_SAMPLE, 1)).max())
    signed = any(code == 2 for code in np.atleast_1d(image.tag_v2.get(TIFF_SAMPLE_FORMAT, 1)))
    if bits not in TIFF_BITS or signed:
        raise UserError(
            f"{path} is a TIFF of {bits} {'signed ' * signed}bits a channel; expected 8 or 16, unsigned, or "
            "EXR. Export it again."
        )
    meaning = image.tag_v2.get(TIFF_PHOTOMETRIC, TIFF_RGB)
    if bits == 16 and meaning not in TIFF_DEEP:
        raise UserError(
            f"{path} is a TIFF of 16 bits a channel that holds neither grey nor RGB (photometric "
            f"interpretation {meaning}); export it as RGB."
        )
    apart = image.tag_v2.get(TIFF_PLANAR, 1) == TIFF_APART and image.tag_v2.get(TIFF_SAMPLES_PER_PIXEL, 1) > 1
    if bits == 16 and apart:  # which OpenCV takes for interleaved: every channel would be the first
        raise UserError(
            f"{path} is a TIFF of 16 bits whose channels stand one after the other (planar configuration 2); "
            "export it with interleaved channels."
        )


def decoded_by_opencv(path: Path, data: bytes) -> np.ndarray:
    """Decode bytes as they are, channels as RGB, alpha dropped; the orientation tag is not applied."""
    if fault := fault_of_chunks(data):
        raise unreadable(path, fault)
    try:
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise unreadable(path, error) from error
    if decoded is None:
        raise unreadable(path, "no decoder knows it")
    return decoded if decoded.ndim == 2 else decoded[..., 2::-1]


def unreadable(path: Path, why: object) -> UserError:
    reason = " ".join(str(why).split())[:200]
    return UserError(
        f"{path} cannot be read as an image ({reason}); copy it again from its source or remove it."
    )
