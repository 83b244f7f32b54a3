"""Reliability of confidence: measured against expected errors of the albedo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.evaluation.scaled_error import least_squares_scale
from stages.photometry.albedo.settings import ConfidenceSettings

CLASSES = 5
DARK = 1e-3  # of the brightest true albedo, under the logarithm


@dataclass(frozen=True)
class Reliability:
    """Pixels of all views in classes of equal number, the least confident first.

    Attributes
    ----------
    held : tuple of float
        Share of the squared error of the albedo, all channels, that each class holds.
    expected : tuple of float
        Median of the relative errors that the confidence implies; infinite where it is 0.
    measured : tuple of float
        Root mean square of the logarithm of the albedo's brightness over the true one's, less its median.
    """

    held: tuple[float, ...]
    expected: tuple[float, ...]
    measured: tuple[float, ...]

    @classmethod
    def of(cls, confidence: np.ndarray, albedo: np.ndarray, truth: np.ndarray) -> Reliability:
        """Compare confidence (N,) with errors of albedo against truth (N, 3) after one scale per channel."""
        scale = [least_squares_scale(albedo[:, c], truth[:, c]) for c in range(3)]
        scaled = albedo * np.array(scale)
        square = ((scaled - truth) ** 2).sum(axis=1, dtype=np.float64)
        dark = DARK * float(truth.max(initial=0.0)) + 1e-12
        off = np.log((scaled.mean(axis=1) + dark) / (truth.mean(axis=1) + dark)).astype(np.float64)
        off -= np.median(off)
        with np.errstate(divide="ignore"):
            sigma = ConfidenceSettings().half_error * np.sqrt(
                1 / np.maximum(confidence.astype(np.float64), 0) - 1
            )
        classes = np.array_split(np.argsort(confidence, kind="stable"), CLASSES)
        total = max(float(square.sum()), 1e-30)
        return cls(
            held=tuple(float(square[own].sum()) / total for own in classes),
            expected=tuple(float(np.median(sigma[own])) for own in classes),
            measured=tuple(float(np.sqrt(np.mean(off[own] ** 2))) for own in classes),
        )
