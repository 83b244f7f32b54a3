"""A view's maps as 8-bit pictures: what each kind means in colours."""

from __future__ import annotations

import cv2
import numpy as np

from stages.formats.images.photos import encode_srgb8
from stages.reporting.settings import PictureSettings

AS_EXPLAINED = np.array([128, 128, 128], np.float32)
TOO_DARK = np.array(
    [20, 60, 200], np.float32
)  # of the residual: blue and orange, which the colour-blind tell apart
TOO_BRIGHT = np.array([230, 120, 0], np.float32)
NEARLY_BLACK = 1e-4  # of white: below it a ratio says nothing
STEPS = 65535  # of linear light in the table below: the darkest 8-bit code is twenty of them
SRGB8 = encode_srgb8(np.arange(STEPS + 1) / STEPS)


def area_mean(values: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Reduce a map, (h, w[, 3]), float32, to height and width, at most its own, by area."""
    if values.shape[:2] == size:
        return values
    return cv2.resize(values, (size[1], size[0]), interpolation=cv2.INTER_AREA)


def masked_mean(values: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Reduce a map by area, over the pixels of a mask alone; 0 where there are none.

    Parameters
    ----------
    values : ndarray, shape (h, w) or (h, w, 3), float32
        0 outside the mask.
    share : ndarray, shape (height, width), float32
        `area_mean` of the mask.

    Returns
    -------
    ndarray, shape (height, width) or (height, width, 3), float32
    """
    whole = np.maximum(share, np.float32(1e-6))
    return area_mean(values, share.shape) / (whole if values.ndim == 2 else whole[..., None])


def srgb_picture(linear: np.ndarray) -> np.ndarray:
    """Encode linear light, any shape, as sRGB, uint8, by a table: a third of the time of `encode_srgb8`."""
    return SRGB8[np.rint(np.clip(linear, 0, 1) * np.float32(STEPS)).astype(np.uint16)]


def photo_picture(photo: np.ndarray, settings: PictureSettings) -> np.ndarray:
    """Encode a linear photo, (h, w, 3), as sRGB, uint8; one that exceeds 1 is scaled by its mean."""
    white = max(float(photo.mean()) * settings.sheet_white, 1e-6) if photo.max(initial=0) > 1 else 1.0
    return srgb_picture(photo / white)


def normal_picture(normals: np.ndarray) -> np.ndarray:
    """Encode unit normals, (h, w, 3), world axes, as colours: x, y, z from −1 to 1 as red, green, blue."""
    return np.rint((normals * 0.5 + 0.5).clip(0, 1) * 255).astype(np.uint8)


def depth_picture(depth: np.ndarray, nearest: float, farthest: float) -> np.ndarray:
    """Encode depth, (h, w), as colours from yellow (near) to violet (far): a map that greys keep in order."""
    share = (farthest - depth) / max(farthest - nearest, 1e-12)
    levels = np.rint(share.clip(0, 1) * 255).astype(np.uint8)
    return cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS)[..., ::-1]


def confidence_picture(confidence: np.ndarray) -> np.ndarray:
    """Encode confidence, (h, w), 0 to 1, as grey: white is certain."""
    grey = np.rint(confidence.clip(0, 1) * 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def residual_picture(photo: np.ndarray, albedo: np.ndarray, shading: np.ndarray, stops: float) -> np.ndarray:
    """Encode log2 of photo over albedo × shading, of the mean of the channels, as colours.

    Grey where the product is the photo, orange where the photo is brighter, blue where it is darker; full
    colour from `stops` on. All (h, w, 3), linear.
    """
    seen, explained = photo.mean(axis=2), (albedo * shading).mean(axis=2)
    least = NEARLY_BLACK * max(float(seen.max(initial=0)), 1e-12)
    ratio = np.log2(np.maximum(seen, least) / np.maximum(explained, least)) / stops
    strength = np.abs(ratio).clip(0, 1)[..., None]
    colour = np.where(ratio[..., None] > 0, TOO_BRIGHT, TOO_DARK)
    return np.rint((1 - strength) * AS_EXPLAINED + strength * colour).astype(np.uint8)
