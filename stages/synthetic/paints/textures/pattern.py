"""What a texture gives, and the smooth edges that textures are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.synthetic.paints.solid_noise import fractal_noise

COLOUR_OF_STONE = 0.3  # deviation of chroma, per deviation of tone: greys and browns
SHARED_WITH_TONE = 0.6  # correlation of that chroma with tone


@dataclass(frozen=True)
class Scale:
    """Wavelengths of a texture, model units: `finest` of its detail, `largest` of its layout."""

    finest: float
    largest: float


@dataclass(frozen=True, eq=False)
class Pattern:
    """A texture without its contrast.

    Attributes
    ----------
    tone : ndarray, shape (n,)
        Log brightness, up to an offset and a factor; constant where the paint is flat.
    chroma : ndarray, shape (n, 2)
        Log colour towards warm (red over blue) and towards green (green over red and blue), in units of one
        standard deviation of `tone`.
    """

    tone: np.ndarray
    chroma: np.ndarray


def stone_colour(x: np.ndarray, tone: np.ndarray, scale: Scale, seed: int) -> np.ndarray:
    """Chroma with a 1/f spectrum of its own, partly correlated with a standardised tone; shape (n, 2)."""
    own = np.stack([fractal_noise(x, scale.largest, scale.finest, seed + 40 * k) for k in range(2)], axis=-1)
    warm = SHARED_WITH_TONE * tone + np.sqrt(1 - SHARED_WITH_TONE**2) * own[:, 0]
    return COLOUR_OF_STONE * np.stack([warm, 0.4 * own[:, 1]], axis=-1)


def standardised(values: np.ndarray) -> np.ndarray:
    """Subtract the mean and divide by the standard deviation; zeros where the values are constant."""
    deviation = values.std()
    return (values - values.mean()) / deviation if deviation > 1e-9 else np.zeros(len(values))


def smooth_step(value: np.ndarray, edge: float, width: float) -> np.ndarray:
    """0 below, 1 above `edge`, smooth over ± `width`."""
    t = np.clip((value - edge) / (2 * width) + 0.5, 0, 1)
    return t * t * (3 - 2 * t)
