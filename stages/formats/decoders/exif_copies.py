"""EXIF data of a photo for another picture of the same view."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from PIL import Image

from stages.formats.decoders.pictures import (
    DECODING_FAILED,
    EXIF_DIRECTORIES,
    EXIF_ORIENTATION,
    exif_directory,
    exif_of,
)

# Description, make, model, resolution, program, time, artist, copyright: what describes a photo, and not how
# its file lays out the pixels, as most tags of TIFF and raw do.
DESCRIBING = (0x010E, 0x010F, 0x0110, 0x011A, 0x011B, 0x0128, 0x0131, 0x0132, 0x013B, 0x8298)
COLOUR_SPACE, SRGB = 0xA001, 1
# Makers' notes hold places in the file that they were in; interoperability says which colours were meant.
NOT_COPIED = (0x927C, 0xA005)
PIXELS_WIDE, PIXELS_HIGH = 0xA002, 0xA003
LONGEST = 60_000  # bytes; JPEG has room for 65,533
HEADER_IN_JPEG = b"Exif\0\0"  # before the byte order


def copied_exif(path: Path, orientation: int, size: tuple[int, int]) -> Image.Exif:
    """Copy what a photo's EXIF data say of how and where it was taken, for a picture in sRGB.

    Data that cannot be written again are left out.

    Parameters
    ----------
    path : Path
    orientation : int
        Of the pixels that will be written, 1 to 8.
    size : tuple of int
        Their width and height as stored.
    """
    found, copied = exif_of(path), Image.Exif()
    for tag in DESCRIBING:
        with suppress(*DECODING_FAILED):
            if (value := found.get(tag)) is not None:
                _keep_if_writable(copied, tag, value)
    details, position = (
        {tag: value for tag, value in exif_directory(found, directory).items() if tag not in NOT_COPIED}
        for directory in EXIF_DIRECTORIES
    )
    if details:
        details |= {COLOUR_SPACE: SRGB, PIXELS_WIDE: size[0], PIXELS_HIGH: size[1]}
    for directory, values in zip(EXIF_DIRECTORIES, (details, position), strict=True):
        if values:
            _keep_if_writable(copied, directory, values)
    copied[EXIF_ORIENTATION] = orientation
    return copied


def exif_block(exif: Image.Exif) -> bytes:
    """Write EXIF data from their byte order on, as PNG has them."""
    return exif.tobytes().removeprefix(HEADER_IN_JPEG)


def _keep_if_writable(exif: Image.Exif, tag: int, value: object) -> None:
    exif[tag] = value
    try:
        fits = len(exif.tobytes()) <= LONGEST
    except (AttributeError, *DECODING_FAILED):  # a value of another type than its tag has
        fits = False
    if not fits:
        del exif[tag]
