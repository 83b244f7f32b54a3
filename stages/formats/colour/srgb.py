"""The sRGB transfer curve, both ways (IEC 61966-2-1). Photos cross it once, when they are read."""

from __future__ import annotations

import numpy as np


def linear_from_srgb(encoded: np.ndarray) -> np.ndarray:
    """Decode sRGB values in [0, 1], any shape, to linear light, float32 in [0, 1]."""
    encoded = np.asarray(encoded, np.float32)
    return np.where(
        encoded <= np.float32(0.04045),
        encoded / np.float32(12.92),
        ((encoded + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4),
    )


def srgb_from_linear(linear: np.ndarray) -> np.ndarray:
    """Encode linear light, any shape, as sRGB, float32 in [0, 1]; clipped to [0, 1] first."""
    linear = np.clip(np.asarray(linear, np.float32), 0, 1)
    return np.where(
        linear <= np.float32(0.0031308),
        linear * np.float32(12.92),
        np.float32(1.055) * linear ** np.float32(1 / 2.4) - np.float32(0.055),
    )
