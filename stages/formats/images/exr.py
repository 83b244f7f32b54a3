"""OpenEXR files, float32: linear images (3 channels) and raw maps such as depth (1 channel)."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from pipeline import UserError
from stages.formats.colour.rgb_primaries import REC_709, Primaries

HAS_WHITE = "hasWhitePoint"  # an attribute of our own
MOST_VALUES = 1 << 30  # of all parts and channels: four channels of the largest photo


def write_exr(
    path: Path,
    image: np.ndarray,
    *,
    half: bool = False,
    is_colour: bool = True,
    primaries: Primaries = REC_709,
    has_white: bool = False,
) -> None:
    """Write `image`, (h, w) as Y, (h, w, 3) as RGB or (h, w, 4) as RGBA; ZIP, float32 unless `half`.

    The header says that colours are linear light of these primaries, unless three channels are no colour; and
    that they are of a photo with a white point, if they are. The folder is made.

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
    header: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if pixels.ndim > 2 and is_colour:
        header["chromaticities"] = primaries
    if has_white:
        header[HAS_WHITE] = 1
    try:
        with OpenEXR.File(header, {"Y" if pixels.ndim == 2 else "RGBA"[: pixels.shape[2]]: pixels}) as file:
            file.write(str(path))
    except RuntimeError as error:  # all that the binding says of a full disk
        raise OSError(errno.EIO, f"it was cut short: {error}", str(path)) from error


def check_exr_header(path: Path) -> tuple[int, int]:
    """Read width and height, px, from the header; refuse one that promises too much.

    Raises
    ------
    UserError
        The file is not an EXR, or all its parts and channels have more than `MOST_VALUES` values.
    """
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            headers = [part.header for part in file.parts]
            sizes = [_window_size(header) for header in headers]
            values = sum(
                width * height * len(header["channels"])
                for (width, height), header in zip(sizes, headers, strict=True)
            )
    except Exception as error:  # the binding raises bare RuntimeErrors of many texts
        raise UserError(
            f"{path} cannot be read as OpenEXR ({error}); export it again or remove it."
        ) from error
    if values > MOST_VALUES or min(min(size) for size in sizes) < 1:
        raise UserError(
            f"{path} claims to be {sizes[0][0]} × {sizes[0][1]} pixels, and {values} values in all its parts "
            f"and channels; expected at most {MOST_VALUES}. Scale it down, or remove channels."
        )
    return sizes[0]


def says_white(path: Path) -> bool:
    """Read whether an EXR of ours is of a photo with a white point, in which what is as bright is clipped.

    Raises
    ------
    UserError
        As `check_exr_header`.
    """
    check_exr_header(path)
    with OpenEXR.File(str(path), header_only=True) as file:
        return HAS_WHITE in file.header()


def _window_size(header: dict[str, Any]) -> tuple[int, int]:
    low, high = header["dataWindow"]
    return int(high[0]) - int(low[0]) + 1, int(high[1]) - int(low[1]) + 1


def read_exr_alpha(path: Path) -> np.ndarray | None:
    """Read the channel A of an EXR, (h, w), float32; None without, by the header alone.

    Raises
    ------
    UserError
        As `read_exr`.
    """
    check_exr_header(path)
    with OpenEXR.File(str(path), header_only=True) as file:
        names = {channel.name for channel in file.header()["channels"]}
    return _channels(path)["A"] if "A" in names else None


def read_exr(path: Path) -> np.ndarray:
    """Read an EXR as float32: (h, w, 3) from R, G, B channels, else (h, w) from its single channel.

    Raises
    ------
    UserError
        The file is not an EXR, has neither RGB nor exactly one channel, or more than `MOST_VALUES` values.
    """
    check_exr_header(path)
    if (colours := _joined_colours(path)) is not None:
        return colours
    channels = _channels(path)
    if {"R", "G", "B"} <= channels.keys():
        return np.stack([channels[name] for name in "RGB"], axis=-1)
    colourless = [name for name in channels if name != "A"]
    if len(colourless) == 1:
        return channels[colourless[0]]
    raise UserError(f"{path} has the channels {sorted(channels)}; expected R, G and B, or a single one.")


def _joined_colours(path: Path) -> np.ndarray | None:
    """Read R, G, B pixel by pixel, so that nothing has to be stacked; None where the binding cannot.

    It cannot where channels are of several types; what is damaged is told by who reads them one by one.
    """
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            names = {channel.name for channel in file.header()["channels"]}
        if not {"R", "G", "B"} <= names:
            return None
        with OpenEXR.File(str(path)) as file:
            pixels = file.channels()["RGBA" if "A" in names else "RGB"].pixels
            return np.ascontiguousarray(pixels[..., :3], np.float32)
    except Exception:  # the binding raises bare RuntimeErrors of many texts
        return None


def _channels(path: Path) -> dict[str, np.ndarray]:
    """Read all channels of the first part, by name."""
    check_exr_header(path)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return {name: np.asarray(channel.pixels, np.float32) for name, channel in file.channels().items()}
    except Exception as error:  # the binding raises bare RuntimeErrors of many texts
        raise UserError(
            f"{path} cannot be read as OpenEXR ({error}); export it again or remove it."
        ) from error
