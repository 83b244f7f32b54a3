"""Camera noise, estimated from differences between views, or from the octaves of one view."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from stages.photometry.detail.octaves import response_to_noise
from stages.photometry.detail.settings import ClassSettings, DetailSettings, NoiseSettings
from stages.photometry.detail.statistics_by_class import by_size, deviation, line_through

TINY, TINIER = 1e-7, 1e-8  # against division by 0, of variances of logarithms


def relative_noise_variance(explained: np.ndarray, offset: float) -> np.ndarray:
    """Compute the variance of noise up to a factor, (N, 3), of mean logarithm, log R/G and log B/G.

    Under photon noise, the variance of ``log(I + d)`` in a channel is proportional to 1/(E + d), E the
    modelled image; that of an axis is the sum over its channels.
    """
    red, green, blue = 1 / (np.maximum(explained, 0) + offset).T
    return np.stack([(red + green + blue) / 9, red + green, blue + green], axis=1)


def relative_noise(variance: np.ndarray, typical: np.ndarray, how: NoiseSettings) -> np.ndarray:
    """Compute noise relative to that of a typical variance, (N, 3), float32, within the range of scales."""
    return np.clip(np.sqrt(variance / typical), how.least_scale, how.most_scale).astype(np.float32)


def noise_between_views(difference: np.ndarray, texture: np.ndarray, classes: ClassSettings) -> float:
    """Estimate noise as the standard deviation of differences between views, extrapolated to no texture.

    Parameters
    ----------
    difference : ndarray, shape (n,)
        Of a band, between a view and the mean of the others; normalised to unit variance for unit noise.
    texture : ndarray, shape (n,)
        Local mean square of the next coarser band: its noise is independent, its texture similar.
    classes : ClassSettings

    Notes
    -----
    Texture that is misregistered by half a pixel differs between views as well. In classes of equal number
    by texture t², ``d² ≈ N + m t²`` is fitted by non-negative least squares over relative errors.
    """
    groups = by_size(texture, classes)
    strengths = [texture[own].mean() for own in groups]
    line = line_through(strengths, [deviation(difference[own]) ** 2 for own in groups], TINY)
    return float(np.sqrt(line.intercept)) if line else 0.0


def noise_of_one_view(sizes: list[np.ndarray], quotients: list[np.ndarray], how: DetailSettings) -> float:
    """Estimate white noise from single views, where correspondences are few.

    Parameters
    ----------
    sizes, quotients : list of ndarray, shape (n,)
        Of the finest octaves: local mean squares of the band of log S, and the band of log I/S over the
        relative noise at its brightness.
    how : DetailSettings

    Notes
    -----
    Where the shading is most even, texture t and noise N are distinguished by their spectra: white noise
    halves from one octave to the next. ``variance_k ≈ t² s_k² + N² w_k²``, s the spectrum of texture, w the
    response to white noise, is fitted by non-negative least squares over relative errors.
    """
    deviations = [_least_deviation(*each, how) for each in zip(sizes, quotients, strict=True)]
    spectrum, count = how.noise.texture_spectrum, len(deviations)
    variances = np.square(deviations)
    relative = 1 / (variances + TINIER)
    design = np.square([spectrum[:count], response_to_noise(how.sigmas_px)[:count]]).T * relative[:, None]
    (_, noise), _ = nnls(design, variances * relative)
    return float(np.sqrt(noise))


def _least_deviation(size: np.ndarray, band: np.ndarray, how: DetailSettings) -> float:
    """Find the least standard deviation among the classes with the most even shading."""
    groups = by_size(size, how.classes)
    even = groups[: max(1, int(len(groups) * how.noise.even_share))]
    return min((deviation(band[own]) for own in even), default=0.0)
