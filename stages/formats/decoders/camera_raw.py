"""Camera raw, developed to linear light by LibRaw (the extra `raw`), all photos of a set alike."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline import UserError
from pipeline.process.installation import install_extra

if TYPE_CHECKING:
    import rawpy

QUARTER_TURNS = (5, 6)  # of `sizes.flip`, as LibRaw numbers them: by 90° either way
AS_IN_EXIF = {3: 3, 5: 8, 6: 6}


def raw_size(path: Path, as_stored: bool) -> tuple[int, int]:
    """Read width and height, px, upright or as stored, from the header only.

    Raises
    ------
    UserError
        The file is damaged, of an unknown camera, or the extra is not installed.
    """
    with _opened(path) as raw:
        sizes = raw.sizes
    turned = sizes.flip in QUARTER_TURNS and not as_stored
    return (sizes.height, sizes.width) if turned else (sizes.width, sizes.height)


def raw_orientation(path: Path) -> int:
    """Read the orientation, 1 to 8, as EXIF numbers it.

    Raises
    ------
    UserError
        As `raw_size`.
    """
    with _opened(path) as raw:
        return AS_IN_EXIF.get(raw.sizes.flip, 1)


def read_raw(path: Path, as_stored: bool) -> np.ndarray:
    """Develop to linear sRGB, (h, w, 3), float32; 1 is where the sensor is saturated.

    The white balance is that of daylight for the camera's model, not what the camera measured, and the white
    level is the sensor's, not that of the photo: all photos of a camera are on one scale.

    Raises
    ------
    UserError
        As `raw_size`.
    """
    import rawpy

    with _opened(path) as raw:
        try:
            raw.unpack()
            developed = raw.postprocess(
                gamma=(1, 1),
                output_bps=16,
                output_color=rawpy.ColorSpace.sRGB,
                no_auto_bright=True,
                adjust_maximum_thr=0.0,  # else the white level follows the photo's brightest pixels
                use_camera_wb=False,
                use_auto_wb=False,
                user_flip=0 if as_stored else None,
            )
        except (rawpy.LibRawError, ValueError, MemoryError) as error:
            raise _unreadable(path, error) from error
    return developed.astype(np.float32) / np.float32(np.iinfo(np.uint16).max)


@contextmanager
def _opened(path: Path) -> Iterator[rawpy.RawPy]:
    try:
        import rawpy
    except ImportError as error:
        raise UserError(
            f"{path} is camera raw, which takes the extra `raw`: {install_extra('raw')}. Or export it "
            "as TIFF or EXR."
        ) from error
    raw = rawpy.RawPy()
    try:
        try:
            raw.open_file(str(path))
        except (rawpy.LibRawError, OSError) as error:
            raise _unreadable(path, error) from error
        yield raw
    finally:
        raw.close()


def _unreadable(path: Path, error: Exception) -> UserError:
    what = error.args[0] if error.args else error
    text = what.decode("utf-8", "replace") if isinstance(what, bytes) else str(what)
    return UserError(
        f"{path} cannot be read as camera raw ({text}); copy it again from its source, or export it as TIFF "
        "or EXR."
    )
