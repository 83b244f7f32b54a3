"""Limits of texture where the light changes, from that on evenly lit surface.

Paint does not know where the light changes. What is left of the residual there, and is stronger than on
evenly lit surface, is error of the shading: displaced borders of shadows, crevices that the mesh lacks.
"""

from __future__ import annotations

import numpy as np

from stages.photometry.detail.settings import DetailSettings
from stages.photometry.detail.shading_uncertainty import TINY
from stages.photometry.detail.statistics_by_class import by_size


def texture_limit(
    energy: np.ndarray, change: np.ndarray, sample: np.ndarray, how: DetailSettings
) -> np.ndarray:
    """Compute the greatest local energy of texture by the local change of shading.

    Parameters
    ----------
    energy : ndarray, shape (N, c)
        Local energy of the residual in c axes, less that of noise and of the shading's known error.
    change : ndarray, shape (N,)
        Local mean square of the shading's own change.
    sample : ndarray of int
        Indices of the pixels that statistics are from.
    how : DetailSettings

    Returns
    -------
    ndarray, shape (N, c)
        In classes of pixels by `change`, the limit under which their mean energy is `texture_factor` times
        that of evenly lit pixels, which leaves a class with less as it is; between classes interpolated.
    """
    size, seen = change[sample], energy[sample]
    classes = by_size(size, how.classes)
    if not classes:
        return np.full(energy.shape, np.inf, np.float32)
    even = size <= np.quantile(size, how.even_share)
    most = how.texture_factor * seen[even].mean(axis=0, dtype=np.float64)
    at = [np.log(size[own].mean() + TINY) for own in classes]
    limits = np.log(
        [[limit_for_mean(*axis) for axis in zip(seen[own].T, most, strict=True)] for own in classes]
    )
    where = np.log(change + TINY)
    return np.stack([np.exp(np.interp(where, at, axis)) for axis in limits.T], axis=1).astype(np.float32)


def limit_for_mean(values: np.ndarray, mean: float) -> float:
    """Solve ``mean(min(values, limit)) = mean`` for the limit; the greatest value if theirs is less."""
    rising = np.concatenate([[0.0], np.sort(values.astype(np.float64))])
    greater = len(values) - np.arange(len(rising))
    means = (np.cumsum(rising) + greater * rising) / len(values)  # of the values, limited to each in turn
    return max(float(np.interp(mean, means, rising)), TINY)
