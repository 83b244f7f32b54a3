"""Masks, the user's and stereo's, at the size of the views that are decomposed."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from stages.formats.images.photos import read_mask

ALL_KEPT = 0.999  # share of a reduced pixel: all, but for rounding


def kept_at(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """Read the mask of what is kept of a view, at `shape` (height, width); everything without a mask file.

    A reduced pixel is kept only if all that it averages is: otherwise background would leak into it.
    """
    if not path.exists():
        return np.ones(shape, bool)
    return _wholly(read_mask(path), shape)


def background_at(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """Read where stereo told even background of a view, at `shape` (height, width); nowhere without a file.

    A reduced pixel is background if any part of it is.
    """
    return ~_wholly(~read_mask(path), shape) if path.exists() else np.zeros(shape, bool)


def _wholly(pixels: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Reduce a mask to the pixels all of which it has."""
    if pixels.shape == shape:
        return pixels
    height, width = shape
    return cv2.resize(pixels.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA) > ALL_KEPT


def nothing_kept(which: str) -> str:
    """Say that `which`, the beginning of the sentence, keeps no pixel, and what masks should be."""
    return (
        f"{which} keeps a pixel; expected white (255, at least 128) where the object is. Masks of 0 and 1 "
        "have to be multiplied by 255."
    )
