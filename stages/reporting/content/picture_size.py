"""The size of pictures at which all of them together fit into the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from io import BytesIO

import cv2
import numpy as np
from PIL import Image

from stages.reporting.settings import PictureSettings

Pictures = Mapping[str, tuple[np.ndarray, np.ndarray | None]]  # by kind: pixels, and which are visible
SMALLEST_PX = 32  # a picture of fewer pixels shows nothing


def encode_webp(pixels: np.ndarray, visible: np.ndarray | None, how: PictureSettings) -> bytes:
    """Compress a picture as WebP.

    Parameters
    ----------
    pixels : ndarray, shape (h, w, 3), uint8
    visible : ndarray, shape (h, w), bool, or None
        The picture is transparent elsewhere; None: nowhere.
    how : PictureSettings
        `quality` and `effort`.
    """
    if visible is not None:
        alpha = np.where(visible, 255, 0).astype(np.uint8)
        pixels = np.dstack([np.where(visible[..., None], pixels, 128).astype(np.uint8), alpha])
    stream = BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(stream, "WEBP", quality=how.quality, method=how.effort)
    return stream.getvalue()


def size_within(shape: tuple[int, int], longest_px: int) -> tuple[int, int]:
    """Compute height and width of an image, at most its own, whose longest side is `longest_px`."""
    scale = min(1.0, longest_px / max(shape))
    return max(1, round(shape[0] * scale)), max(1, round(shape[1] * scale))


def side_that_fits(tried: Sequence[Pictures], views: int, how: PictureSettings) -> int:
    """Choose the longest side at which the pictures of so many views fit, by those of some views.

    Parameters
    ----------
    tried : sequence of mapping of str to (ndarray, ndarray or None)
        Per view and kind the pixels, (h, w, 3), uint8, and which are visible, (h, w), bool, at `largest_px`.
    views : int
    how : PictureSettings
    """

    def bytes_at(side: int) -> float:
        taken = 0
        for pixels, visible in (picture for view in tried for picture in view.values()):
            shown = None if visible is None else reduced_picture(visible.astype(np.uint8), side) > 0
            taken += len(encode_webp(reduced_picture(pixels, side), shown, how))
        return taken / len(tried) * views

    return longest_side(how.largest_px, bytes_at, how.megabytes * 1e6)


def longest_side(longest_px: int, bytes_at: Callable[[int], float], most_bytes: float) -> int:
    """Choose the longest side at which pictures take at most so many bytes.

    Parameters
    ----------
    longest_px : int
        At most.
    bytes_at : callable
        Bytes of all pictures at a side, px.
    most_bytes : float

    Notes
    -----
    s ← s √(b / bytes(s)) until they fit. Bytes grow a little less than with the square of the side, for
    smaller pictures have more detail per pixel; so it takes a few rounds, all from above.
    """
    side = longest_px
    while side > SMALLEST_PX and (found := bytes_at(side)) > most_bytes:
        side = max(SMALLEST_PX, min(side - 1, int(side * (most_bytes / found) ** 0.5)))
    return side


def reduced_picture(pixels: np.ndarray, longest_px: int) -> np.ndarray:
    """Reduce a picture, (h, w[, 3]), of eight bits or linear light, to a longest side, by area."""
    height, width = size_within(pixels.shape[:2], longest_px)
    if (height, width) == pixels.shape[:2]:
        return pixels
    return cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
