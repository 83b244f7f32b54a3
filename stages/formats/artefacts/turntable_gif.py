"""Pictures one after another, as an animated GIF: it plays everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PIL import Image

COLOURS = 256  # of a GIF, in each picture its own
MILLISECONDS = 1000  # of a second


def write_gif(path: Path, pictures: Sequence[Path], per_second: float) -> None:
    """Write pictures, PNGs of one size, as a GIF that repeats for ever; they are opened one by one."""

    def opened(picture: Path) -> Image.Image:
        with Image.open(picture) as image:
            return image.convert("RGB").quantize(COLOURS)

    first, *others = pictures
    opened(first).save(
        path,
        save_all=True,
        append_images=(opened(other) for other in others),
        duration=round(MILLISECONDS / per_second),
        loop=0,
        optimize=False,
    )
