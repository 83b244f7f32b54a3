"""Prices of light from all around: of differences between its directions, and between its channels."""

from __future__ import annotations

import numpy as np


def contrast(light: np.ndarray, cells: np.ndarray) -> tuple[float, np.ndarray]:
    """Mean of ``√(1 + d²) − 1``, d the light's deviation from its mean in units of the mean; all channels.

    What differs a little costs its square; a sun what it is bright, for by its square it would become broad.
    """
    mean = _mean(light, cells)
    price, by_off = _rooted(light / mean - 1, cells)
    return price, (by_off - cells[:, None] * (by_off * light / mean).sum(axis=1, keepdims=True)) / mean


def colour_contrast(light: np.ndarray, cells: np.ndarray) -> tuple[float, np.ndarray]:
    """Mean of ``2 (√(1 + d²) − 1)``, d the channels' deviation from their mean; whatever the white balance.

    Every channel is taken in units of its own mean over the cells, (M,). A tinge costs its square; a red lamp
    what it is red, for by its square it would be white.
    """
    mean = _mean(light, cells)
    part = light / mean
    price, by_off = _rooted(part - part.mean(axis=2, keepdims=True), cells)
    by_part = by_off - by_off.mean(axis=2, keepdims=True)
    by_mean = cells[:, None] * (by_part * part).sum(axis=1, keepdims=True)
    return 2 * price, 2 * (by_part - by_mean) / mean


def _mean(light: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Of every light and channel, (G, 1, 3)."""
    return np.maximum((cells[:, None] * light).sum(axis=1, keepdims=True), 1e-12)


def _rooted(off: np.ndarray, cells: np.ndarray) -> tuple[float, np.ndarray]:
    """Mean over lights and cells of ``√(1 + d²) − 1``, channels added; and the slope by d, (G, M, 3)."""
    root, weight = np.sqrt(1 + off**2), cells[:, None] / len(off)
    return float((weight * (root - 1)).sum()), weight * off / root
