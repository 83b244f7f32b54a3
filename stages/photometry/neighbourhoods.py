"""Means over neighbourhoods of pixels, inside the masks, and sums at pixel indices."""

from __future__ import annotations

import cv2
import numpy as np

from stages.photometry.stack import StackedViews

PATCHES = 15  # along the side of a view: size of the neighbourhoods classified as textured or glossy


def patch_means(views: StackedViews, values: np.ndarray) -> np.ndarray:
    """Average the values, (N,), in a patch around every pixel, (N,)."""
    return means_around(views, values, patch_side(views))


def patch_side(views: StackedViews) -> int:
    """Compute the side of such a patch, px: odd, at least 3."""
    return max(3, 2 * round(views.side / PATCHES / 2) + 1)


def means_around(views: StackedViews, values: np.ndarray, size_px: int) -> np.ndarray:
    """Average the values, (N,), in a square around every pixel, inside its mask, (N,), float32."""
    return np.concatenate(
        [_means(mask, values[views.view(number)], size_px) for number, mask in enumerate(views.masks)]
    )


def add_at(total: np.ndarray, pixels: np.ndarray, values: np.ndarray | float) -> None:
    """Add values at pixel indices, in order; indices may repeat.

    Values are converted first: NumPy takes six times as long where it has to convert within `np.add.at`.
    """
    np.add.at(total, pixels, np.asarray(values, total.dtype))


def _means(mask: np.ndarray, values: np.ndarray, size_px: int) -> np.ndarray:
    image = np.zeros(mask.shape, np.float32)
    image[mask] = values
    total, full = (
        cv2.boxFilter(one, -1, (size_px, size_px), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for one in (image, mask.astype(np.float32))
    )
    return (total / np.maximum(full, 1))[mask]
