"""OpenEXR files, float32: linear images (3 channels) and raw maps such as depth (1 channel)."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import OpenEXR

from pipeline import UserError


def write_exr(path: Path, image: np.ndarray, *, half: bool = False) -> None:
    """Write `image`, (h, w) as Y or (h, w, 3) as RGB; ZIP, float32 unless `half`; makes the folder.

    Raises
    ------
    ValueError
        A value is not finite, or would not be as half: a fault of the program, which must not be published.
    OSError
        It cannot be written, or not all of it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with np.errstate(over="ignore"):
        pixels = np.ascontiguousarray(image, np.float16 if half else np.float32)
    if not np.isfinite(pixels).all():
        raise ValueError(f"{np.count_nonzero(~np.isfinite(pixels))} values of {path.name} are not finite")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    try:
        with OpenEXR.File(header, {"Y" if pixels.ndim == 2 else "RGB": pixels}) as file:
            file.write(str(path))
    except RuntimeError as error:  # all that the binding says of a full disk
        raise OSError(errno.EIO, f"it was cut short: {error}", str(path)) from error


def read_exr(path: Path) -> np.ndarray:
    """Read an EXR as float32: (h, w, 3) from R, G, B channels, else (h, w) from its single channel.

    Raises
    ------
    UserError
        The file is not an EXR, or has neither RGB nor exactly one channel.
    """
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {
                name: np.asarray(channel.pixels, np.float32) for name, channel in file.channels().items()
            }
    except Exception as error:  # the binding raises bare RuntimeErrors of many texts
        raise UserError(
            f"{path} cannot be read as OpenEXR ({error}); export it again or remove it."
        ) from error
    if {"R", "G", "B"} <= channels.keys():
        return np.stack([channels[name] for name in "RGB"], axis=-1)
    colourless = [name for name in channels if name != "A"]
    if len(colourless) == 1:
        return channels[colourless[0]]
    raise UserError(f"{path} has the channels {sorted(channels)}; expected R, G and B, or a single one.")
