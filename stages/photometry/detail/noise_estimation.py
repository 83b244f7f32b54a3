"""The camera's noise, estimated from what views do not share, or from one view's octaves."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from stages.photometry.detail.octaves import response_to_noise
from stages.photometry.detail.shading_uncertainty import DARK
from stages.photometry.statistics_by_class import by_size, deviation, line_through

TEXTURE = (0.6, 1.0, 1.0, 1.0, 1.0)  # of 1/f brightness, a little blurred: deviations of the finest octaves
TINY = 1e-7


def grain_of(explained: np.ndarray) -> np.ndarray:
    """Noise by brightness, (N, 3), float32, of mean logarithm, log R/G and log B/G: 1 where it is median.

    Photons' variance grows as their number does, so a channel's ``log(I + d)`` varies by 1/(E + d) of what is
    explained, E; the axes by the sum of these over their channels. From a half to eight.
    """
    red, green, blue = 1 / (np.maximum(explained, 0) + DARK).T
    variance = np.stack([(red + green + blue) / 9, red + green, blue + green], axis=1)
    typical = np.median(variance, axis=0) if len(variance) else 1.0
    return np.clip(np.sqrt(variance / typical), 0.5, 8.0).astype(np.float32)


def noise_between_views(difference: np.ndarray, texture: np.ndarray) -> float:
    """Standard deviation of what views do not share, where surface has no texture.

    Parameters
    ----------
    difference : ndarray, shape (n,)
        Of a band between a view and the mean of its others, by the standard deviation that it has for noise
        of 1 in each.
    texture : ndarray, shape (n,)
        Local mean square of the next coarser band: noise there is another, texture is much the same.

    Notes
    -----
    Texture that views see half a pixel off differs between them as well: in classes of equal number by
    texture t², ``d² ≈ N + m t²``, by non-negative least squares over relative errors.
    """
    classes = by_size(texture)
    strengths = [texture[own].mean() for own in classes]
    line = line_through(strengths, [deviation(difference[own]) ** 2 for own in classes], TINY)
    return float(np.sqrt(line.intercept)) if line else 0.0


def noise_of_one_view(sizes: list[np.ndarray], quotients: list[np.ndarray]) -> float:
    """Estimate white noise from a view alone, where no other shows the same.

    Parameters
    ----------
    sizes, quotients : list of ndarray, shape (n,)
        Of the finest octaves: local mean squares of the band of log S, and the band of log I/S by the noise
        at its brightness.

    Notes
    -----
    Where the shading is most even, what is left is told by its octaves: noise is white and halves from one
    to the next, texture is as strong in all.
    """
    deviations = [_least_deviation(*each) for each in zip(sizes, quotients, strict=True)]
    count = min(len(TEXTURE), len(deviations))
    variances = np.square(deviations[:count])
    relative = 1 / (variances + 1e-8)
    design = np.square([TEXTURE[:count], response_to_noise()[:count]]).T * relative[:, None]
    (_, noise), _ = nnls(design, variances * relative)
    return float(np.sqrt(noise))


def _least_deviation(size: np.ndarray, band: np.ndarray) -> float:
    """Of the class that varies least among those in which the shading is most even."""
    classes = by_size(size)
    return min((deviation(band[own]) for own in classes[: max(1, len(classes) // 8)]), default=0.0)
