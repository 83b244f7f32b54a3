"""Maps of the parts of a scene whose albedo is uniform: PNG of part numbers, and the names to them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline import UserError
from stages.formats.decoders.pictures import DECODED, DECODING_FAILED


def read_part_names(path: Path) -> tuple[str, ...]:
    """Read the names of the parts 1, 2, …, from ``{"parts": ["hair", …]}``.

    Raises
    ------
    UserError
        The file is not there, or holds something else.
    """
    try:
        names = json.loads(path.read_text(encoding="utf-8"))["parts"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(
            f'{path} cannot be read ({type(error).__name__}); expected {{"parts": ["hair", …]}}, the names '
            "to the numbers in parts/."
        ) from error
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise UserError(f"{path} holds {names!r} under `parts`; expected a list of names.")
    if len(set(names)) < len(names):
        raise UserError(f"{path} names a part twice ({', '.join(names)}); expected every name once.")
    return tuple(names)


def read_part_map(path: Path, part_count: int) -> np.ndarray:
    """Read the number of the part at each pixel, (h, w), uint8: 0 for none, else 1 to `part_count`.

    Raises
    ------
    UserError
        The file is not an 8-bit image of one channel, or a number in it has no name.
    """
    try:
        with Image.open(path, formats=DECODED) as image:
            mode, numbers = image.mode, np.asarray(image)
    except DECODING_FAILED as error:
        raise UserError(f"{path} cannot be read as an image ({error}); expected a map of parts.") from error
    if mode not in ("L", "P"):
        raise UserError(f"{path} has the pixel type {mode}; expected 8-bit grey, a part's number per pixel.")
    if numbers.max(initial=0) > part_count:
        raise UserError(
            f"{path} holds the number {numbers.max()}, but parts.json has {part_count} name(s); expected a "
            "name for every number."
        )
    return numbers
