"""Standard uncertainty of the shading, octave by octave, estimated from the quotient of photo and shading."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from stages.photometry.detail.settings import DetailSettings
from stages.photometry.detail.statistics_by_class import by_size, deviation, line_through

TINY = 1e-12  # against logarithms of and division by 0, of squares


@dataclass(frozen=True)
class ShadingUncertainty:
    """Standard uncertainties of shading and photos, estimated from the scene.

    Attributes
    ----------
    shown : tuple of float
        Per octave, finest first: share of the shading's own change that the photos show, on average.
    of_change : tuple of float
        Per octave: standard deviation of the error over the shading's own local change, as reduced.
    noise : tuple of 3 float
        Standard deviation of the camera's noise in a working pixel of median brightness: of the mean
        logarithm, of log R/G and log B/G.
    """

    shown: tuple[float, ...]
    of_change: tuple[float, ...]
    noise: tuple[float, float, float]

    def as_json(self) -> dict[str, Any]:
        """Convert to JSON values for records."""
        brightness, *chroma = (round(value, 4) for value in self.noise)
        return {
            "shading_shown_by_photos": [round(value, 3) for value in self.shown],
            "of_shading_change": [round(value, 3) for value in self.of_change],
            "noise": brightness,
            "noise_of_chroma": chroma,
        }


def log_quotient(image: np.ndarray, explained: np.ndarray, offset: float) -> np.ndarray:
    """Compute ``log((I + d) / (E + d))``, elementwise, float32; near 0 where both are dark."""
    return np.log((np.maximum(image, 0) + offset) / (np.maximum(explained, 0) + offset)).astype(np.float32)


def log_shading(light: np.ndarray) -> np.ndarray:
    """Average the logarithms of the channels of a positive shading, (N, 3); (N,), float32."""
    return np.log(light).mean(axis=1).astype(np.float32)


def uncertain_energy(error: float, size: np.ndarray, noise: np.ndarray, how: DetailSettings) -> np.ndarray:
    """Compute the energy of a residual explained by error of shading and noise, ``κ² L² + noise``, (n, 3).

    Parameters
    ----------
    error : float
        κ.
    size : ndarray, shape (n,)
        Local mean square L² of the shading's own change.
    noise : ndarray, shape (n, 3)
        Variance of the noise, in the axes of the residual.
    how : DetailSettings
    """
    of_axes = np.square(np.array(how.uncertainty.of_axes, np.float32))
    return error**2 * size[:, None] * of_axes + noise


@dataclass(frozen=True, eq=False)
class ShownChange:
    """Excess of the change in the photos over that of the shading: −1, none is shown; 0, all of it.

    Attributes
    ----------
    log_size : ndarray, shape (k,)
        Logarithms of the mean squares of the shading's local change, per class; ascending.
    excess : ndarray, shape (k,)
    """

    log_size: np.ndarray
    excess: np.ndarray

    @classmethod
    def of(
        cls, change: np.ndarray, left: np.ndarray, size: np.ndarray, sigma_px: float, how: DetailSettings
    ) -> ShownChange:
        """Regress the residual on the shading, in one octave.

        Parameters
        ----------
        change : ndarray, shape (n,)
            Band of the log shading, times the response of ``log(I + d)``.
        left : ndarray, shape (n,)
            Band of log I/(ρ S).
        size : ndarray, shape (n,)
            Local mean square of `change`.
        sigma_px : float
            Lower σ of the octave: values closer than that are not independent.
        how : DetailSettings

        Notes
        -----
        In classes of equal number by size, the slope of `left` on `change`: 0 if the shading is right, −1 if
        the photos show no such change, as of bumps of the stereo depth and facets of the interpolated
        visibility. The square of the slope is reduced by that of some standard errors.
        """
        log_size, excess, limits = [], [], how.uncertainty
        for own in by_size(size, how.classes):
            shade, rest = change[own].astype(np.float64), left[own].astype(np.float64)
            likely = np.abs(rest) <= limits.outlier_deviations * deviation(rest)
            shade, rest = shade[likely], rest[likely]
            # sums rather than BLAS products: the same bits whatever the number of threads
            power = float(np.sum(shade**2))
            if power <= 0:
                continue
            slope = float(np.sum(shade * rest)) / power
            independent = len(rest) / (1 + 4 * np.pi * sigma_px**2)
            chance = float(np.sum(rest**2)) / power / max(independent, 1)
            significant = max(0.0, 1 - limits.standard_errors**2 * chance / max(slope**2, TINY))
            log_size.append(np.log(size[own].mean() + TINY))
            excess.append(np.clip(slope * significant, -1, limits.largest_excess))
        return cls(np.array(log_size), np.array(excess))

    def reduction(self, change: np.ndarray, stated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute what a residual loses, and the local mean square of the change that is left, (n,) each.

        `change`: band of the log shading, times the response; `stated`: its local mean square.
        """
        excess = self.at(stated)
        return excess * change, (1 + excess) ** 2 * stated

    def at(self, size: np.ndarray) -> np.ndarray:
        """Interpolate the excess to local mean squares of the shading's change, float32."""
        if not len(self.excess):
            return np.zeros(len(size), np.float32)
        return np.interp(np.log(size + TINY), self.log_size, self.excess).astype(np.float32)

    @property
    def shown(self) -> float:
        """Mean share of the shading's change that the photos show, over the classes."""
        return float(1 + self.excess.mean()) if len(self.excess) else 1.0


def error_of_change(size: np.ndarray, quotient: np.ndarray, left: np.ndarray, how: DetailSettings) -> float:
    """Estimate κ, the standard deviation of the shading's error over its own local change, in one octave.

    Parameters
    ----------
    size : ndarray, shape (n,)
        Local mean square L² of the band of log S.
    quotient, left : ndarray, shape (n,)
        Bands of log I/S, and of log I/(ρ S) with a smooth albedo ρ.
    how : DetailSettings

    Notes
    -----
    In classes of equal number by L², e² is the variance of the band of log I/S, estimated by the median so
    that borders of materials do not count. ``e² ≈ τ² + κ² L²`` is fitted by non-negative least squares over
    relative errors: κ is the shading's error, τ texture and noise. κ² is reduced by its standard error. A
    second estimate uses log I/(ρ S) and mean squares, since borders are in ρ. Albedo biases both upwards,
    the first by strong borders, the second by detail that ρ lacks. The smaller is used, times
    `estimate_factor`.
    """
    classes = by_size(size, how.classes)
    by_median = _slope(classes, size, lambda own: deviation(quotient[own]) ** 2)
    by_square = _slope(classes, size, lambda own: np.mean(np.square(left[own]), dtype=np.float64))
    return how.uncertainty.estimate_factor * min(by_median, by_square)


def _slope(classes: list[np.ndarray], size: np.ndarray, variance_of: Callable[[np.ndarray], float]) -> float:
    """Fit κ, with κ² reduced by its standard error."""
    strengths = [size[own].mean() for own in classes]
    line = line_through(strengths, [variance_of(own) for own in classes], 1e-6)
    return float(np.sqrt(max(line.slope - line.error, 0.0))) if line else 0.0
