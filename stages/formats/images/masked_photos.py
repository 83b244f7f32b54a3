"""Photos with their masks, checked against the model's sizes, without values that are no light."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline import UserError
from stages.formats.images.alpha import read_alpha
from stages.formats.images.photo_folder import LINEAR
from stages.formats.images.photo_settings import FireflySettings
from stages.formats.images.photos import read_mask, read_photo

LARGEST_LIGHT = 1e30  # beyond, sums over pixels are no numbers any more


def read_masked_photo(
    photo: Path,
    mask: Path | None,
    size: tuple[int, int],
    as_stored: bool,
    with_alpha: bool,
    most_times_bright: float,
    fireflies: FireflySettings,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Read a photo and which of its pixels may be used.

    Parameters
    ----------
    photo : Path
    mask : Path or None
        White = keep.
    size : (int, int)
        Width and height that the model says.
    as_stored : bool
        Whether the model means its pixels as they are stored, whatever the header says of its orientation.
    with_alpha : bool
        Whether an alpha channel is a mask, too.
    most_times_bright : float
        `photo_settings.MOST_TIMES_BRIGHT`.
    fireflies : FireflySettings
        Which level of the photo, and of a pixel's neighbourhood, that is a multiple of.

    Returns
    -------
    linear : ndarray, shape (h, w, 3), float32
        Finite: 0 where the file is not, or too bright.
    kept : ndarray, shape (h, w), bool
    impossible : int
        How many pixels are not numbers, or too bright, and so not kept.

    Raises
    ------
    UserError
        The sizes of photo, mask and model differ.
    """
    linear = read_photo(photo, as_stored)
    height, width = linear.shape[:2]
    if (width, height) != size:
        raise UserError(
            f"{photo} is {width} × {height} pixels, but its camera in the model is {size[0]} × {size[1]}; "
            "give the photos that the model was made from."
        )
    kept = read_kept(photo, mask, (width, height), as_stored, with_alpha)
    most_times_bright = most_times_bright if photo.suffix.lower() in LINEAR else float("inf")
    possible = _possible(linear, most_times_bright, fireflies)
    if possible.all():
        return linear, kept, 0
    impossible = int(np.count_nonzero(~possible))
    return np.where(possible[..., None], linear, np.float32(0)), kept & possible, impossible


def read_kept(
    photo: Path, mask: Path | None, size: tuple[int, int], as_stored: bool, with_alpha: bool
) -> np.ndarray:
    """Read which pixels of a photo its mask keeps, and its alpha channel; shape (h, w), bool.

    Parameters
    ----------
    photo, mask, as_stored, with_alpha
        As in `read_masked_photo`.
    size : (int, int)
        Width and height of the photo.

    Raises
    ------
    UserError
        The mask is unreadable, or of another size.
    """
    width, height = size
    kept = np.ones((height, width), bool) if mask is None else read_mask(mask, as_stored)
    if kept.shape != (height, width):
        raise UserError(
            f"The mask {mask} is {kept.shape[1]} × {kept.shape[0]} pixels, its photo {width} × {height}; "
            "masks must have their photo's size."
        )
    if with_alpha and (opaque := read_alpha(photo, as_stored)) is not None:
        kept = kept & opaque
    return kept


def _possible(linear: np.ndarray, most_times_bright: float, fireflies: FireflySettings) -> np.ndarray:
    """Which pixels may be light from a surface, (h, w), bool; NaN and infinity are beyond any bound.

    Beyond the bound of the whole photo, and of what is around as well: a small thing before a dark wall is
    as bright as its own neighbourhood.
    """
    largest = np.abs(linear).max(axis=2)
    possible = largest <= LARGEST_LIGHT
    lit = largest[(largest > 0) & possible]
    if not len(lit):
        return possible
    bright = float(np.quantile(lit, fireflies.photo_quantile)) * most_times_bright
    rows, columns = np.nonzero(possible & (largest > bright))
    around = _level_around(np.where(possible, largest, 0), rows, columns, fireflies)
    possible[rows, columns] = largest[rows, columns] <= np.maximum(around * most_times_bright, 0)
    return possible


def _level_around(
    values: np.ndarray, rows: np.ndarray, columns: np.ndarray, fireflies: FireflySettings
) -> np.ndarray:
    """Level of the square around each pixel: the value that `brighter_neighbours` of it reach, (n,)."""
    padded = np.pad(values, fireflies.neighbourhood_px)
    side = 2 * fireflies.neighbourhood_px + 1
    offsets = np.arange(side)
    around = padded[rows[:, None, None] + offsets[:, None], columns[:, None, None] + offsets]
    rank = max(1, round(fireflies.brighter_neighbours * side * side))
    return np.partition(around.reshape(-1, side * side), -rank, axis=1)[:, -rank]
