"""Photographs, read as linear light; 8- and 16-bit sRGB pictures, written; masks, both ways.

Pillow opens, measures and checks files (headers, integrity, EXIF, CMYK, palettes); OpenCV decodes what
Pillow would cut to 8 bits. Decoding always works on bytes: OpenCV's own file access fails on some paths.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError
from PIL.TiffImagePlugin import TiffImageFile

from pipeline import UserError
from stages.formats.colour.icc_profiles import read_profile
from stages.formats.colour.srgb import linear_from_srgb, srgb_from_linear
from stages.formats.images.exr import check_exr_header, read_exr
from stages.formats.images.png_chunks import chunks_before_pixels, fault_of_chunks

# Three floats per pixel: 3 GB at this size. Checked from the header, before anything is allocated; Pillow's
# own guard is switched off because it warns at a third of this.
LARGEST_PHOTO_PX = 256_000_000
MOST_PX_PER_BYTE = 10_000  # deflate packs a thousand bytes into one; a bit is a pixel at least
Image.MAX_IMAGE_PIXELS = None

# What Pillow raises on damaged files; it warns about damaged EXIF, which strict callers turn into an error.
DECODING_FAILED = (
    *(OSError, SyntaxError, ValueError, EOFError, LookupError, TypeError, ArithmeticError, MemoryError),
    *(struct.error, UserWarning),
)

# Pillow knows some fifty kinds by their first bytes, whatever the name says; one runs Ghostscript.
DECODED = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "GIF")

EXIF_ORIENTATION = 0x0112
TIFF_BITS_PER_SAMPLE = 258
TIFF_SAMPLE_FORMAT = 339
TIFF_PHOTOMETRIC = 262
TIFF_RGB = 2
TIFF_DEEP = (1, TIFF_RGB)  # what OpenCV decodes at 16 bits: grey whose 0 is black, and RGB
TIFF_BITS = (1, 2, 4, 8, 16)


def photo_size(path: Path, as_stored: bool = False) -> tuple[int, int]:
    """Read width and height, px, upright (EXIF orientation applied) or as stored, from the header only.

    Raises
    ------
    UserError
        The file is unreadable, larger than `LARGEST_PHOTO_PX`, or has too few bytes for its pixels.
    """
    bounded = False  # EXR and HDR have their own checks
    if path.suffix.lower() == ".exr":
        width, height = check_exr_header(path)
    elif path.suffix.lower() == ".hdr":
        width, height = _hdr_size(path)
    else:
        with opened(path) as image:
            width, height = image.size
            bounded = image.format != "WEBP"  # of which a hundred bytes may be any size
            upright_already = image.format == "TIFF"  # Pillow reports its size so
            if _orientation(image, path) >= 5 and upright_already == as_stored:
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

    JPEG, PNG and TIFF (8 or 16 bits; grey, palette, alpha, CMYK) are taken as sRGB, or as an embedded profile
    of curves and a matrix says; alpha is dropped. EXR and HDR are linear already and come as they are. What
    is passed over: `photo_remarks.remarks_on`.

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
        linear = _decoded_by_opencv(path, path.read_bytes())
    else:
        encoded, profile = _read_encoded(path)
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
    values, _ = _read_encoded(path)
    if as_stored:
        values = turned_back(values, orientation_of(path))
    brightest = values[..., :3].max(axis=-1) if values.ndim == 3 else values
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
    _write_png(path, encode_srgb8(linear))


def write_png_srgb16(path: Path, linear: np.ndarray) -> None:
    """Write linear light, (h, w, 3) or (h, w), as a 16-bit sRGB PNG, creating the folder."""
    _write_png(path, encode_srgb16(linear))


def write_png8(path: Path, pixels: np.ndarray) -> None:
    """Write 8-bit values as they are, uint8, (h, w, 3) RGB or (h, w), as PNG, creating the folder."""
    _write_png(path, pixels)


def _read_encoded(path: Path) -> tuple[np.ndarray, bytes]:
    """Upright values as stored, uint8 or uint16, (h, w, 3) or (h, w), RGB; and the profile, or nothing."""
    with opened(path) as image:
        deep, profile = _is_16_bit(image, path), _profile_of(image, path)
        orientation = 1 if image.format == "TIFF" else _orientation(image, path)
        try:
            image.load()  # Pillow alone notices truncation; its TIFF reader turns the image upright here
            if not deep:
                return upright(np.asarray(image.convert("RGB")), orientation), profile
        except DECODING_FAILED as error:
            raise unreadable(path, error) from error
        if image.format == "TIFF":  # OpenCV's reader turns TIFF upright by itself, too
            orientation = 1
    return upright(_decoded_by_opencv(path, path.read_bytes()), orientation), profile


def _profile_of(image: Image.Image, path: Path) -> bytes:
    """Read the embedded ICC profile; nothing without, or where a PNG's coding (cICP) comes before it."""
    profile = image.info.get("icc_profile") or b""
    return b"" if profile and b"cICP" in chunks_before_pixels(path) else bytes(profile)


def orientation_of(path: Path) -> int:
    """Read the orientation that the header gives, 1 to 8; 1, upright as stored, where it gives none.

    Raises
    ------
    UserError
        The file is unreadable.
    """
    if path.suffix.lower() in (".exr", ".hdr"):
        return 1
    with opened(path) as image:
        return _orientation(image, path)


def turned_back(image: np.ndarray, orientation: int) -> np.ndarray:
    """As stored, from upright: quarter turns are undone by each other, all else by itself."""
    return upright(image, {6: 8, 8: 6}.get(orientation, orientation))


def upright(image: np.ndarray, orientation: int) -> np.ndarray:
    """Undo an EXIF orientation (1 to 8; anything else counts as 1), shape (h, w[, c])."""
    if 5 <= orientation <= 8:
        image = image.swapaxes(0, 1)
    flip_rows = orientation in (3, 4, 7, 8)
    flip_columns = orientation in (2, 3, 6, 7)
    return image[:: -1 if flip_rows else 1, :: -1 if flip_columns else 1]


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


def _orientation(image: Image.Image, path: Path) -> int:
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


def _decoded_by_opencv(path: Path, data: bytes) -> np.ndarray:
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


def _write_png(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    ordered = np.ascontiguousarray(pixels[..., ::-1]) if pixels.ndim == 3 else pixels
    _, data = cv2.imencode(".png", ordered)
    path.write_bytes(data.tobytes())


def unreadable(path: Path, why: object) -> UserError:
    reason = " ".join(str(why).split())[:200]
    return UserError(
        f"{path} cannot be read as an image ({reason}); copy it again from its source or remove it."
    )
