"""Priors of light from all around: on its contrast between directions, and between channels."""

from __future__ import annotations

import numpy as np


def contrast(light: np.ndarray, cells: np.ndarray) -> tuple[float, np.ndarray]:
    """Compute the mean of ``√(1 + d²) − 1``, d the deviation of light from its mean, relative; with gradient.

    The cost is quadratic for small contrast and linear for large: a quadratic cost would blur a sun.
    """
    mean = _mean(light, cells)
    price, by_off = _rooted(light / mean - 1, cells)
    return price, (by_off - cells[:, None] * (by_off * light / mean).sum(axis=1, keepdims=True)) / mean


def colour_contrast(light: np.ndarray, cells: np.ndarray) -> tuple[float, np.ndarray]:
    """Compute the mean of ``2 (√(1 + d²) − 1)``, d the channels' deviation from their mean; with gradient.

    Every channel is divided by its own mean over the cells, (M,), which removes white balance. The cost is
    quadratic for weak tints and linear for strong ones: a quadratic cost would bleach a red lamp.
    """
    mean = _mean(light, cells)
    part = light / mean
    price, by_off = _rooted(part - part.mean(axis=2, keepdims=True), cells)
    by_part = by_off - by_off.mean(axis=2, keepdims=True)
    by_mean = cells[:, None] * (by_part * part).sum(axis=1, keepdims=True)
    return 2 * price, 2 * (by_part - by_mean) / mean


def _mean(light: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Compute the mean radiance of every light and channel, (G, 1, 3)."""
    return np.maximum((cells[:, None] * light).sum(axis=1, keepdims=True), 1e-12)


def _rooted(off: np.ndarray, cells: np.ndarray) -> tuple[float, np.ndarray]:
    """Average ``√(1 + d²) − 1`` over lights and cells, summed over channels; with gradient, (G, M, 3)."""
    root, weight = np.sqrt(1 + off**2), cells[:, None] / len(off)
    return float((weight * (root - 1)).sum()), weight * off / root
