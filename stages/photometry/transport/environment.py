"""The light as a picture of all directions."""

from __future__ import annotations

import numpy as np

from stages.photometry.transport.directional_transport import AROUND, honeycomb

ROWS = 64


def directions_of_picture(rows: int = ROWS) -> np.ndarray:
    """Unit vectors behind a picture of all directions, (rows, 2 · rows, 3), world axes.

    As environment maps have it, with z up: the zenith in the first row, the middle column towards −y, and the
    azimuth falling from left to right, so that the picture is seen from inside.
    """
    polar = np.pi * (np.arange(rows) + 0.5) / rows
    azimuth = np.pi / 2 - 2 * np.pi * (np.arange(2 * rows) + 0.5) / (2 * rows)
    ring = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    across = np.sin(polar)[:, None, None] * ring[None]
    up = np.broadcast_to(np.cos(polar)[:, None, None], (rows, 2 * rows, 1))
    return np.concatenate([across, up], axis=2)


def picture_of_light(
    directions: np.ndarray, radiance: np.ndarray, cells: np.ndarray | None = None, rows: int = ROWS
) -> np.ndarray:
    """Light (M, C) from directions (M, 3) as a picture, (rows, 2 · rows, C), float32.

    Every pixel is a blend of the directions around it, Gaussian, as wide as they are apart. Each direction
    stands for a cell, a share of all directions, (M,); None: all alike. Where some are finer, the others are
    divided as well, for else their broader Gaussians would dim what is bright.
    """
    towards = directions_of_picture(rows).reshape(-1, 3)
    if cells is not None:
        coarse = np.flatnonzero(cells > 2 * np.min(cells))
        around = honeycomb(directions[coarse], cells[coarse] / (AROUND + 1))
        directions = np.concatenate([directions, around])
        radiance = np.concatenate([radiance, radiance[np.repeat(coarse, AROUND)]])
    spacing = 2 / np.sqrt(len(directions))  # radians: about half of √(4π/M), which they are apart
    weight = np.exp((towards @ np.asarray(directions, np.float64).T - 1) / (0.5 * spacing**2))
    blended = (weight @ radiance) / weight.sum(axis=1, keepdims=True)
    return blended.reshape(rows, 2 * rows, -1).astype(np.float32)
