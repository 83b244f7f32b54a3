"""The light as a picture of all directions."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from stages.photometry.transport.directional_transport import AROUND, honeycomb
from stages.photometry.transport.settings import EnvironmentMapSettings, LightPictureSettings


def directions_of_picture(rows: int) -> np.ndarray:
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
    directions: np.ndarray, radiance: np.ndarray, how: LightPictureSettings, cells: np.ndarray | None = None
) -> np.ndarray:
    """Draw light (M, C) from directions (M, 3) as a picture, (rows, 2 · rows, C), float32.

    Every pixel is a blend of the directions around it, Gaussian, as wide as they are apart. Each direction
    stands for a cell, a share of all directions, (M,); None: all alike. Where some are finer, the others are
    divided as well, for else their broader Gaussians would dim what is bright.
    """
    rows = how.rows
    towards = directions_of_picture(rows).reshape(-1, 3)
    if cells is not None:
        coarse = np.flatnonzero(cells > 2 * np.min(cells))
        around = honeycomb(directions[coarse], cells[coarse] / (AROUND + 1))
        directions = np.concatenate([directions, around])
        radiance = np.concatenate([radiance, radiance[np.repeat(coarse, AROUND)]])
    radius = how.blur / np.sqrt(len(directions))  # radians; they are √(4π/M) apart
    weight = np.exp((towards @ np.asarray(directions, np.float64).T - 1) / (0.5 * radius**2))
    blended = (weight @ radiance) / weight.sum(axis=1, keepdims=True)
    return blended.reshape(rows, 2 * rows, -1).astype(np.float32)


def light_of_picture(picture: np.ndarray, directions: np.ndarray, how: EnvironmentMapSettings) -> np.ndarray:
    """Mean light, (M, 3), around each of some even directions, (M, 3), of a picture of all directions.

    Every pixel belongs to the direction nearest to it, and counts by the solid angle that it covers. Pictures
    with more rows are reduced first, which hardly changes the light of some thousand directions.
    """
    if picture.shape[0] > how.max_rows:
        picture = cv2.resize(picture, (2 * how.max_rows, how.max_rows), interpolation=cv2.INTER_AREA)
    rows = picture.shape[0]
    towards = directions_of_picture(rows).reshape(-1, 3)
    angle = np.repeat(np.sin(np.pi * (np.arange(rows) + 0.5) / rows), 2 * rows)
    _, nearest = cKDTree(directions).query(towards)
    count = len(directions)
    total = np.bincount(nearest, angle, count)
    sums = [np.bincount(nearest, angle * picture[..., c].ravel(), count) for c in range(3)]
    light = np.stack(sums, axis=1) / np.where(total > 0, total, 1)[:, None]
    _, pixel = cKDTree(towards).query(directions)
    return np.where(total[:, None] > 0, light, picture.reshape(-1, 3)[pixel])  # finer than the picture


def turned_light(
    picture: np.ndarray,
    turn_deg: float,
    upright_from_world: np.ndarray,
    directions: np.ndarray,
    how: EnvironmentMapSettings,
) -> np.ndarray:
    """Radiance from each of the world's directions, (M, 3), of a picture that is turned about the vertical.

    Counter-clockwise seen from above; turning the light turns the directions the other way.
    """
    turn = np.deg2rad(-turn_deg)
    turned = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    return light_of_picture(picture, directions @ (turned @ upright_from_world).T, how)
