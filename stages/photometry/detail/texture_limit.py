"""Limits of texture where the light changes, from that on evenly lit surface.

Paint does not know where the light changes. What is left of the residual there, and is stronger than on
evenly lit surface, is error of the shading: displaced borders of shadows, crevices that the mesh lacks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.detail.settings import DetailSettings
from stages.photometry.detail.shading_uncertainty import TINY
from stages.photometry.detail.statistics_by_class import by_size


@dataclass(frozen=True, eq=False)
class TextureLimit:
    """Greatest local energy of texture by the local change of shading.

    Attributes
    ----------
    log_change : ndarray, shape (k,)
        Logarithms of the local mean square of the shading's own change, per class; ascending.
    log_limit : ndarray, shape (c, k)
        Logarithms of the limit in each of c axes.
    """

    log_change: np.ndarray
    log_limit: np.ndarray

    @classmethod
    def of(cls, energy: np.ndarray, change: np.ndarray, how: DetailSettings) -> TextureLimit:
        """Find the limits from a sample of pixels.

        Parameters
        ----------
        energy : ndarray, shape (n, c)
            Local energy of the residual in c axes, less that of noise and of the shading's known error.
        change : ndarray, shape (n,)
            Local mean square of the shading's own change.
        how : DetailSettings

        Notes
        -----
        In classes of pixels by `change`, the limit under which their mean energy is `texture_factor` times
        that of evenly lit pixels, which leaves a class with less as it is. Too few pixels have no limit.
        """
        classes = by_size(change, how.classes)
        if not classes:
            return cls(np.zeros(1), np.full((energy.shape[1], 1), np.inf))
        even = change <= np.quantile(change, how.even_share)
        most = how.texture_factor * energy[even].mean(axis=0, dtype=np.float64)
        at = np.array([np.log(change[own].mean() + TINY) for own in classes])
        limits = [
            [limit_for_mean(*axis) for axis in zip(energy[own].T, most, strict=True)] for own in classes
        ]
        return cls(at, np.log(limits).T)

    def filtered(
        self,
        band: np.ndarray,
        energy: np.ndarray,
        uncertain: np.ndarray,
        change: np.ndarray,
        trusted: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Filter a band, (N, c), by the Wiener share of its signal within the limit.

        Returns
        -------
        tuple of ndarray, shape (N, c), and ndarray, shape (N,)
            The share of the band, 0 where it is not trusted, and the expected variance of its first axis.
        """
        signal = np.maximum(energy - uncertain, 0)
        share = np.minimum(signal, self.at(change)) / np.maximum(energy, TINY)
        expected = share**2 * uncertain + (1 - share) ** 2 * energy
        return np.where(trusted[:, None], share * band, 0), expected[:, 0]

    def at(self, change: np.ndarray) -> np.ndarray:
        """Interpolate the limits to a local change of shading, (N,): (N, c), float32."""
        where = np.log(change + TINY)
        limits = [np.exp(np.interp(where, self.log_change, axis)) for axis in self.log_limit]
        return np.stack(limits, axis=1).astype(np.float32)


def limit_for_mean(values: np.ndarray, mean: float) -> float:
    """Solve ``mean(min(values, limit)) = mean`` for the limit; the greatest value if theirs is less."""
    rising = np.concatenate([[0.0], np.sort(values.astype(np.float64))])
    greater = len(values) - np.arange(len(rising))
    means = (np.cumsum(rising) + greater * rising) / len(values)  # of the values, limited to each in turn
    return max(float(np.interp(mean, means, rising)), TINY)
