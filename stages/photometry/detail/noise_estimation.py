"""The camera's noise, estimated from what views do not share, or from one view's octaves."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from stages.photometry.detail.octaves import response_to_noise
from stages.photometry.detail.settings import ClassSettings, DetailSettings
from stages.photometry.detail.statistics_by_class import by_size, deviation, line_through

TINY, TINIER = 1e-7, 1e-8  # against division by 0, of variances of logarithms


def noise_by_brightness(explained: np.ndarray, how: DetailSettings) -> np.ndarray:
    """Compute noise over that at median brightness, (N, 3), float32.

    Of mean logarithm, log R/G and log B/G. Photons' variance grows as their number does, so a channel's
    ``log(I + d)`` varies by 1/(E + d) of what is explained, E; the axes by the sum of these over their
    channels. Limited to the range of scales.
    """
    red, green, blue = 1 / (np.maximum(explained, 0) + how.log_offset).T
    variance = np.stack([(red + green + blue) / 9, red + green, blue + green], axis=1)
    typical = np.median(variance, axis=0) if len(variance) else 1.0
    return np.clip(np.sqrt(variance / typical), how.noise.least_scale, how.noise.most_scale).astype(
        np.float32
    )


def noise_between_views(difference: np.ndarray, texture: np.ndarray, classes: ClassSettings) -> float:
    """Estimate noise as the standard deviation of what views do not share, where surface has no texture.

    Parameters
    ----------
    difference : ndarray, shape (n,)
        Of a band between a view and the mean of its others, by the standard deviation that it has for noise
        of 1 in each.
    texture : ndarray, shape (n,)
        Local mean square of the next coarser band: noise there is another, texture is much the same.
    classes : ClassSettings

    Notes
    -----
    Texture that views see half a pixel off differs between them as well: in classes of equal number by
    texture t², ``d² ≈ N + m t²``, by non-negative least squares over relative errors.
    """
    groups = by_size(texture, classes)
    strengths = [texture[own].mean() for own in groups]
    line = line_through(strengths, [deviation(difference[own]) ** 2 for own in groups], TINY)
    return float(np.sqrt(line.intercept)) if line else 0.0


def noise_of_one_view(sizes: list[np.ndarray], quotients: list[np.ndarray], how: DetailSettings) -> float:
    """Estimate white noise from a view alone, where no other shows the same.

    Parameters
    ----------
    sizes, quotients : list of ndarray, shape (n,)
        Of the finest octaves: local mean squares of the band of log S, and the band of log I/S by the noise
        at its brightness.
    how : DetailSettings

    Notes
    -----
    Where the shading is most even, texture t and noise N are distinguished by their octaves, of which noise
    is white and halves from one to the next: ``variance_k ≈ t² s_k² + N² w_k²``, s the spectrum of texture, w
    the response to white noise, by non-negative least squares over relative errors.
    """
    deviations = [_least_deviation(*each, how) for each in zip(sizes, quotients, strict=True)]
    spectrum, count = how.noise.texture_spectrum, len(deviations)
    variances = np.square(deviations)
    relative = 1 / (variances + TINIER)
    design = np.square([spectrum[:count], response_to_noise(how.sigmas_px)[:count]]).T * relative[:, None]
    (_, noise), _ = nnls(design, variances * relative)
    return float(np.sqrt(noise))


def _least_deviation(size: np.ndarray, band: np.ndarray, how: DetailSettings) -> float:
    """Find the least standard deviation of a class among those in which the shading is most even."""
    groups = by_size(size, how.classes)
    even = groups[: max(1, int(len(groups) * how.noise.even_share))]
    return min((deviation(band[own]) for own in even), default=0.0)
