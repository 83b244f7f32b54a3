"""The views under another light, from their albedo."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from stages.photometry.lighting.light_estimate import SkyScene
from stages.photometry.transport.environment import directions_of_picture
from stages.photometry.transport.pixel_transfer import WHITEST, at_vertices, on_absolute_scale
from stages.photometry.transport.transfer_vectors import bounced

ROWS = 512  # 0.35° each


def light_of_picture(picture: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Mean light, (M, 3), around each of some even directions, (M, 3), of a picture of all directions.

    Every pixel belongs to the direction nearest to it, and counts by the solid angle that it covers. Pictures
    with more rows are reduced first, which hardly changes the light of some thousand directions.
    """
    if picture.shape[0] > ROWS:
        picture = cv2.resize(picture, (2 * ROWS, ROWS), interpolation=cv2.INTER_AREA)
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
    picture: np.ndarray, turn_deg: float, upright_from_world: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    """Radiance from each of the world's directions, (M, 3), of a picture that is turned about the vertical.

    Counter-clockwise seen from above; turning the light turns the directions the other way.
    """
    turn = np.deg2rad(-turn_deg)
    turned = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    return light_of_picture(picture, directions @ (turned @ upright_from_world).T)


def relit(
    scene: SkyScene, albedo: np.ndarray, light: np.ndarray, bounces: int, brightest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Radiance that the pixels would show.

    Parameters
    ----------
    scene : SkyScene
        N pixels, M directions.
    albedo : ndarray, shape (N, 3)
        On any scale, the channels alike.
    light : ndarray, shape (M, 3)
        Radiance from the scene's directions.
    bounces : int
        How often light is passed on between surfaces.
    brightest : float
        What the brightest material reflects.

    Returns
    -------
    tuple of two ndarray, shape (N, 3), float32
        ``ρ S`` with ρ on the absolute scale, and S itself.
    """
    absolute = on_absolute_scale(np.maximum(albedo, 0), brightest)
    shading, of_vertices = scene.pixels.shading(light), scene.vertices.shading(light)
    blend = scene.pixels.blend
    for c in range(3 if bounces and len(absolute) else 0):
        values = np.minimum(absolute[:, c], WHITEST)
        there, typical = at_vertices(blend, scene.nearest_shown, values), float(np.median(values))
        own = np.ascontiguousarray(of_vertices[:, c : c + 1])
        total = bounced(own, scene.proxy.seen, there.astype(np.float32), typical, bounces)
        shading[:, c] += (blend @ (total - own))[:, 0]
    return (absolute * shading).astype(np.float32), shading
