"""Primaries of linear RGB, and the conversion between them."""

from __future__ import annotations

import numpy as np

Primaries = tuple[float, ...]  # x and y of red, green, blue and white, as in an EXR's header

REC_709: Primaries = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # sRGB's
ACESCG: Primaries = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)  # AP1: S-2014-004
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def conversion(source: Primaries, target: Primaries) -> np.ndarray:
    """Compute the matrix from linear RGB of one set of primaries to another, (3, 3).

    White stays white, by Bradford's adaptation: what reflects all light does so in both.
    """
    there, white = _xyz_from_rgb(target), BRADFORD @ _xyz(*target[6:])
    adapted = np.linalg.inv(BRADFORD) @ np.diag(white / (BRADFORD @ _xyz(*source[6:]))) @ BRADFORD
    return np.linalg.inv(there) @ adapted @ _xyz_from_rgb(source)


def _xyz_from_rgb(primaries: Primaries) -> np.ndarray:
    """Scale the primaries such that they add up to white."""
    x, y = np.array(primaries).reshape(4, 2).T
    columns = np.stack([x, y, 1 - x - y])[:, :3]
    return columns * np.linalg.solve(columns, _xyz(x[3], y[3]))


def _xyz(x: float, y: float) -> np.ndarray:
    """Convert chromaticities to XYZ of luminance 1."""
    return np.array([x / y, 1.0, (1 - x - y) / y])
