"""What a sensor adds to a picture; renders come without it, so that it can be turned up on its own."""

from __future__ import annotations

import numpy as np


def with_sensor_noise(linear: np.ndarray, read: float, shot: float, seed: int) -> np.ndarray:
    """Add Gaussian noise of variance ``read² + shot² · value`` to linear values, any shape; float32.

    Parameters
    ----------
    linear : ndarray
        Linear light; negative values have no shot noise.
    read : float
        Standard deviation in the dark, in the unit of the values.
    shot : float
        Standard deviation at value 1 that grows with the square root of the light.
    seed : int
    """
    deviation = np.sqrt(read**2 + shot**2 * np.maximum(linear, 0))
    return (linear + deviation * np.random.default_rng(seed).standard_normal(linear.shape)).astype(np.float32)
