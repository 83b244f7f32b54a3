"""Flat paint: plain, or with a printed pattern."""

from __future__ import annotations

import numpy as np

from stages.synthetic.paints.textures.pattern import Pattern, Scale, smooth_step, standardised

PERIOD = (0.16, 0.30)  # of a print, in units of the largest wavelength


def plaster(x: np.ndarray, scale: Scale, seed: int) -> Pattern:
    """One paint."""
    return Pattern(np.zeros(len(x)), np.zeros((len(x), 2)))


def print_(x: np.ndarray, scale: Scale, seed: int) -> Pattern:
    """A printed pattern in one ink: dots, oblique stripes, or a trellis with dots, drawn by seed."""
    rng = np.random.default_rng(seed)
    period = rng.uniform(*PERIOD) * scale.largest
    edge = 0.5 * scale.finest / period
    azimuth = np.deg2rad(rng.uniform(20, 70))
    level = x[:, 0] * np.cos(azimuth) + x[:, 1] * np.sin(azimuth)
    p, q = (level + x[:, 2]) / period, (level - x[:, 2]) / period
    kind = rng.integers(3)
    if kind == 0:
        ink = _dots(p, q, 0.27, edge)
    elif kind == 1:
        ink = _line(p, 0.22, edge)
    else:
        ink = np.maximum.reduce(
            [_line(p, 0.07, edge), _line(q, 0.07, edge), _dots(p + 0.5, q + 0.5, 0.2, edge)]
        )
    tone = standardised(rng.choice([-1.0, 1.0]) * ink)
    return Pattern(tone, ink[:, None] * rng.uniform(-1.2, 1.2, 2) * [1, 0.6])


def _dots(p: np.ndarray, q: np.ndarray, radius: float, edge: float) -> np.ndarray:
    distance = np.hypot(p - np.round(p), q - np.round(q))
    return 1 - smooth_step(distance, radius, edge)


def _line(p: np.ndarray, half_width: float, edge: float) -> np.ndarray:
    return 1 - smooth_step(np.abs(p - np.round(p)), half_width, edge)
