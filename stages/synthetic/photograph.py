"""Photographs with as many samples as a stated noise asks for; the noise is measured, not guessed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.scene.cameras import Camera
from stages.synthetic.render import Quality, Scene


@dataclass(frozen=True, eq=False)
class Photograph:
    """A rendered picture and what is known of its noise.

    Attributes
    ----------
    image : ndarray, shape (height, width, 3), float32
        Linear.
    noise : float
        Standard deviation of a pixel's value over the mean value, both over the mask and all channels.
    channel_noise : tuple of float
        The same for each channel, over that channel's own mean.
    samples_per_pixel : int
        For each light source.
    """

    image: np.ndarray
    noise: float
    channel_noise: tuple[float, float, float]
    samples_per_pixel: int


def photograph(
    scene: Scene,
    camera: Camera,
    mask: np.ndarray,
    quality: Quality,
    noise: float,
    seed: int,
    most_passes: int = 64,
) -> Photograph:
    """Add independent passes until the scatter between them says that their mean is good enough.

    Parameters
    ----------
    mask : ndarray, shape (height, width), bool
        Where the noise counts.
    quality : Quality
        Of one pass.
    noise : float
        Wanted standard deviation over the mean, at most; two passes at least are made.
    seed : int
        Pass k is seeded with ``seed + k``.
    """
    total = np.zeros((*camera.shape, 3))
    squares = np.zeros((*camera.shape, 3))
    for done in range(1, most_passes + 1):
        image = scene.photograph(camera, quality, seed + done - 1).astype(np.float64)
        total += image
        squares += image * image
        if done == 1:
            continue
        mean = (total / done)[mask]
        variance = np.maximum(squares[mask] - done * mean**2, 0) / (done - 1) / done
        measured = _ratio(variance, mean)
        if measured <= noise:
            break
    channels = tuple(_ratio(variance[:, c], mean[:, c]) for c in range(3))
    return Photograph((total / done).astype(np.float32), measured, channels, done * quality.samples_per_pixel)


def _ratio(variance: np.ndarray, mean: np.ndarray) -> float:
    level = float(mean.mean()) if mean.size else 0.0
    return float(np.sqrt(variance.mean())) / level if level > 0 else 0.0
