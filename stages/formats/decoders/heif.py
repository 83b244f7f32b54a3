"""HEIF (HEIC) photos, as telephones take them, decoded by libheif (the extra `heic`)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline import UserError
from pipeline.process.installation import install_extra

if TYPE_CHECKING:
    import pi_heif

FAILED = (ValueError, RuntimeError, EOFError, OSError, SyntaxError, LookupError, TypeError, MemoryError)


def heif_size(path: Path) -> tuple[int, int]:
    """Read width and height, px, upright, from the header only.

    Raises
    ------
    UserError
        The file is damaged, or the extra is not installed.
    """
    try:
        width, height = _opened(path).size
    except FAILED as error:  # a file without a picture
        raise _unreadable(path, error) from error
    return int(width), int(height)


def read_heif(path: Path) -> tuple[np.ndarray, bytes]:
    """Decode to codes, (h, w[, c]), uint8 or uint16, upright, with alpha if there is; and the ICC profile.

    Raises
    ------
    UserError
        As `heif_size`.
    """
    opened = _opened(path)
    try:
        codes = np.array(opened)  # a copy: the memory is the file's, and freed with it
    except FAILED as error:
        raise _unreadable(path, error) from error
    return codes, bytes(opened.info.get("icc_profile") or b"")


def heif_alpha(path: Path) -> np.ndarray | None:
    """Decode the alpha channel, (h, w), uint8 or uint16, upright; None without, by the header alone.

    Raises
    ------
    UserError
        As `heif_size`.
    """
    return read_heif(path)[0][..., -1] if _opened(path).has_alpha else None


def heif_exif(path: Path) -> bytes:
    """Read the block of EXIF data; empty without.

    Raises
    ------
    UserError
        As `heif_size`.
    """
    return bytes(_opened(path).info.get("exif") or b"")


def _opened(path: Path) -> pi_heif.HeifFile:
    """Open a file without decoding its picture."""
    try:
        import pi_heif
    except ImportError as error:
        raise UserError(
            f"{path} is HEIF, which takes the extra `heic`: {install_extra('heic')}. Or export it as "
            "JPEG or TIFF."
        ) from error
    try:
        return pi_heif.open_heif(path, convert_hdr_to_8bit=False)
    except FAILED as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> UserError:
    reason = " ".join(str(error).split())[:200]
    return UserError(f"{path} cannot be read as HEIF ({reason}); copy it again from its source or remove it.")
