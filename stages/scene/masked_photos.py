"""Photos with their masks, checked against what the model says of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline import UserError
from stages.scene.photos import read_mask, read_photo


def read_masked_photo(photo: Path, mask: Path | None, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Read a photo and which of its pixels may be used.

    Parameters
    ----------
    photo : Path
    mask : Path or None
        White = keep.
    size : (int, int)
        Width and height that the model says.

    Returns
    -------
    linear : ndarray, shape (h, w, 3), float32
        Finite: 0 where the file is not.
    kept : ndarray, shape (h, w), bool

    Raises
    ------
    UserError
        The sizes of photo, mask and model differ.
    """
    linear = read_photo(photo)
    height, width = linear.shape[:2]
    if (width, height) != size:
        raise UserError(
            f"{photo} is {width} × {height} pixels, but its camera in the model is {size[0]} × {size[1]}; "
            "give the photos that the model was made from."
        )
    kept = np.ones((height, width), bool) if mask is None else read_mask(mask)
    if kept.shape != (height, width):
        raise UserError(
            f"The mask {mask} is {kept.shape[1]} × {kept.shape[0]} pixels, its photo {width} × {height}; "
            "masks must have their photo's size."
        )
    finite = np.isfinite(linear).all(axis=2)  # renderers and merging tools leave NaN and infinity behind
    if finite.all():
        return linear, kept
    return np.where(finite[..., None], linear, np.float32(0)), kept & finite
