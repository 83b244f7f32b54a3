"""Bringing images to the size at which the views are decomposed."""

from __future__ import annotations

import cv2
import numpy as np


def reduce_by_area(image: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Average linear light over the area of each larger pixel.

    Parameters
    ----------
    image : ndarray, shape (H, W[, c]), float32
        Linear: averaging encoded values would darken edges.
    shape : (int, int)
        Height and width wanted, at most H and W.

    Returns
    -------
    ndarray, shape (h, w[, c]), float32
        Means of whole blocks where both sides divide evenly, else area-weighted means; the image itself
        where nothing is to be done.

    Raises
    ------
    ValueError
        `shape` is larger than the image: there is nothing to average.
    """
    height, width = shape
    rows, columns = image.shape[:2]
    if (rows, columns) == (height, width):
        return image
    if height > rows or width > columns:
        raise ValueError(f"An image of {columns} × {rows} pixels cannot be reduced to {width} × {height}.")
    if rows % height or columns % width:
        return cv2.resize(np.asarray(image, np.float32), (width, height), interpolation=cv2.INTER_AREA)
    blocks = image.reshape(height, rows // height, width, columns // width, *image.shape[2:])
    return blocks.mean(axis=(1, 3), dtype=np.float64).astype(np.float32)
