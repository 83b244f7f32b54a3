"""Environment maps: conversion between pictures of all directions and radiance per direction."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from stages.photometry.transport.directional_transport import AROUND, honeycomb
from stages.photometry.transport.settings import EnvironmentMapSettings, LightPictureSettings


def directions_of_picture(rows: int) -> np.ndarray:
    """Compute the unit vectors of an environment map's pixels, (rows, 2 · rows, 3), world axes.

    Equirectangular, with z up: the zenith in the first row, the middle column towards −y, and the azimuth
    decreasing from left to right, so that the picture is seen from inside.
    """
    polar = np.pi * (np.arange(rows) + 0.5) / rows
    azimuth = np.pi / 2 - 2 * np.pi * (np.arange(2 * rows) + 0.5) / (2 * rows)
    ring = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    across = np.sin(polar)[:, None, None] * ring[None]
    up = np.broadcast_to(np.cos(polar)[:, None, None], (rows, 2 * rows, 1))
    return np.concatenate([across, up], axis=2)


def picture_of_light(
    directions: np.ndarray,
    radiance: np.ndarray,
    how: LightPictureSettings,
    cells: np.ndarray | None = None,
    suns: int = 0,
) -> np.ndarray:
    """Render light (M, C) from directions (M, 3) as an environment map, (rows, 2 · rows, C), float32.

    Every pixel is a Gaussian blend of the directions around it, as wide as their spacing. Each direction has
    a cell, its share of the sphere, (M,); None: all equal. Where some cells are finer, the others are
    subdivided as well, since their broader Gaussians would dim bright directions. The last
    `suns` directions light the pixel that they lie in.
    """
    rows = how.rows
    towards = directions_of_picture(rows).reshape(-1, 3)
    sunlight = np.zeros((len(towards), radiance.shape[1]))
    if cells is not None:
        spread = len(directions) - suns
        pixel = np.argmax(directions[spread:] @ towards.T, axis=1)
        angle = np.pi * np.sqrt(1 - towards[pixel, 2] ** 2) / (2 * len(towards))  # as a share of the sphere
        np.add.at(sunlight, pixel, radiance[spread:] * (cells[spread:] / angle)[:, None])
        directions, radiance, cells = directions[:spread], radiance[:spread], cells[:spread]
        coarse = np.flatnonzero(cells > 2 * np.min(cells))
        around = honeycomb(directions[coarse], cells[coarse] / (AROUND + 1))
        directions = np.concatenate([directions, around])
        radiance = np.concatenate([radiance, radiance[np.repeat(coarse, AROUND)]])
    radius = how.blur / np.sqrt(len(directions))  # radians; they are √(4π/M) apart
    weight = np.exp((towards @ np.asarray(directions, np.float64).T - 1) / (0.5 * radius**2))
    blended = (weight @ radiance) / weight.sum(axis=1, keepdims=True) + sunlight
    return blended.reshape(rows, 2 * rows, -1).astype(np.float32)


def light_of_picture(picture: np.ndarray, directions: np.ndarray, how: EnvironmentMapSettings) -> np.ndarray:
    """Average an environment map around each of a set of even directions, (M, 3): radiance, (M, 3).

    Every pixel belongs to its nearest direction, weighted by its solid angle. Pictures with more rows than
    `max_rows` are reduced first, which hardly changes the light of some thousand directions.
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
    """Sample radiance from world directions, (M, 3), of an environment map rotated about the vertical.

    The yaw is counter-clockwise seen from above; directions are rotated by its inverse.
    """
    yaw = np.deg2rad(-turn_deg)
    rotation = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    return light_of_picture(picture, directions @ (rotation @ upright_from_world).T, how)
