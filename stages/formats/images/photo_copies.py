"""Pictures written like photos: of their kind as far as it can be written, with their EXIF data, in sRGB."""

from __future__ import annotations

import struct
import zlib
from functools import cache
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
from PIL import Image, ImageCms
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from stages.formats.decoders.exif_copies import copied_exif, exif_block
from stages.formats.decoders.pictures import turned_back
from stages.formats.decoders.png_chunks import said_to_be_srgb
from stages.formats.images.exr import write_exr
from stages.formats.images.photo_folder import LINEAR
from stages.formats.images.photos import encode_srgb8, encode_srgb16, orientation_of
from stages.scene.image_names import CAMERA_RAW, HEIF

OTHER_KINDS = {".avif": ".jpg"} | dict.fromkeys(HEIF, ".jpg") | dict.fromkeys(CAMERA_RAW, ".tif")
WITHOUT_ALPHA = {".jpg": ".png", ".jpeg": ".png", ".hdr": ".exr"}
TIFF_HEAD = struct.pack("<2sHL", b"II", 42, 8)  # the first directory follows
WIDTH, HEIGHT, BITS, COMPRESSION, PHOTOMETRIC, STRIP_OFFSET, SAMPLES, ROWS_PER_STRIP, STRIP_BYTES = (
    *(256, 257, 258, 259, 262, 273, 277, 278, 279),
)
ASSOCIATED, ICC_PROFILE = 338, 34675
DEFLATE, RGB, UNASSOCIATED_ALPHA = 8, 2, 2
PROFILE_DATE = slice(24, 36)


def name_of_copy(name: str, with_alpha: bool) -> str:
    """Choose the name of a picture written like a photo: its own, unless its kind cannot be written.

    HEIC and AVIF become JPEG, camera raw TIFF; with an alpha channel, JPEG becomes PNG and HDR EXR.

    >>> name_of_copy("left/a.JPG", False), name_of_copy("left/a.cr3", False), name_of_copy("a.jpg", True)
    ('left/a.JPG', 'left/a.tif', 'a.png')
    """
    suffix = PurePosixPath(name).suffix
    written = OTHER_KINDS.get(suffix.lower(), suffix)
    if with_alpha:
        written = WITHOUT_ALPHA.get(written.lower(), written)
    return str(PurePosixPath(name).with_suffix(written))


def is_linear(name: str) -> bool:
    """Test whether photos of this name hold light as it is, without a scale and a curve for display."""
    return name.lower().endswith(LINEAR)


def write_like(
    photo: Path, target: Path, linear: np.ndarray, alpha: np.ndarray | None, quality: int, upright: bool
) -> None:
    """Write a picture like a photo of the same view, creating the folder.

    JPEG and WebP have 8 bits, PNG and TIFF 16, EXR and HDR floats.

    Parameters
    ----------
    photo : Path
        Whose EXIF data are copied.
    target : Path
        Its suffix, as of `name_of_copy`, says the kind.
    linear : ndarray, shape (h, w, 3), float32
        1 is white, but in EXR and HDR.
    alpha : ndarray, shape (h, w), bool, or None
        Opaque pixels; None for no such channel.
    quality : int
        Of JPEG and WebP, 1 to 100.
    upright : bool
        Whether the file shall say that its pixels are upright, rather than what the photo says of its own.

    Raises
    ------
    OSError
        It cannot be written, or not all of it.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    suffix = target.suffix.lower()
    if suffix == ".exr":
        write_exr(target, linear if alpha is None else np.dstack([linear, alpha]))
        return
    if suffix == ".hdr":
        target.write_bytes(cv2.imencode(".hdr", np.ascontiguousarray(linear[..., ::-1]))[1].tobytes())
        return
    height, width = linear.shape[:2]
    exif = copied_exif(photo, 1 if upright else orientation_of(photo), (width, height))
    deep = suffix in (".png", ".tif", ".tiff")
    codes = encode_srgb16(linear) if deep else encode_srgb8(linear)
    if alpha is not None:
        opaque = np.where(alpha, np.iinfo(codes.dtype).max, 0).astype(codes.dtype)
        codes = np.dstack([codes, opaque])
    if deep:
        target.write_bytes(_png(codes, exif) if suffix == ".png" else _tiff(codes, exif))
    else:
        _by_pillow(target, codes, quality, exif)


def as_stored(image: np.ndarray, photo: Path) -> np.ndarray:
    """Turn an upright image, (h, w[, c]), as the photo's own pixels are stored."""
    return np.ascontiguousarray(turned_back(image, orientation_of(photo)))


def _by_pillow(target: Path, codes: np.ndarray, quality: int, exif: Image.Exif) -> None:
    """Write JPEG or WebP."""
    form = {"format": "WEBP"} if target.suffix.lower() == ".webp" else {"format": "JPEG", "subsampling": 0}
    Image.fromarray(codes).save(
        target, quality=quality, exif=exif.tobytes(), icc_profile=_srgb_profile(), **form
    )


def _png(codes: np.ndarray, exif: Image.Exif) -> bytes:
    order = [2, 1, 0, 3][: codes.shape[2]]
    _, data = cv2.imencode(".png", np.ascontiguousarray(codes[..., order]))
    return said_to_be_srgb(data.tobytes(), exif_block(exif))


def _tiff(codes: np.ndarray, exif: Image.Exif) -> bytes:
    """Write 16 bits a channel, which Pillow does not, and OpenCV without EXIF data and profile."""
    height, width, samples = codes.shape
    strip = zlib.compress(codes.astype("<u2").tobytes())
    directory = ImageFileDirectory_v2()
    for tag, value in exif.items():
        directory[tag] = value
    directory[WIDTH], directory[HEIGHT] = width, height
    directory[BITS], directory[SAMPLES] = (codes.dtype.itemsize * 8,) * samples, samples
    directory[COMPRESSION], directory[PHOTOMETRIC] = DEFLATE, RGB
    directory[STRIP_OFFSET] = 0  # behind the directory, says Pillow, which adds its length
    directory[ROWS_PER_STRIP], directory[STRIP_BYTES] = height, len(strip)
    directory[ICC_PROFILE] = _srgb_profile()
    if samples > 3:
        directory[ASSOCIATED] = UNASSOCIATED_ALPHA
    return TIFF_HEAD + directory.tobytes(len(TIFF_HEAD)) + strip


@cache
def _srgb_profile() -> bytes:
    """Make the ICC profile of sRGB, without the date, so that equal pictures are equal files."""
    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    profile[PROFILE_DATE] = bytes(PROFILE_DATE.stop - PROFILE_DATE.start)
    return bytes(profile)
