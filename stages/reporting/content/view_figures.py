"""Figures of a view and of all: surface, residual, confidence, and how much of the variation is light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline import finite_or_null


@dataclass(frozen=True, eq=False)
class SampledView:
    """Values of some pixels of a view, evenly chosen in its mask.

    Attributes
    ----------
    coverage : float
        Share of the picture inside the mask.
    photo, albedo, shading : ndarray, shape (n, 3), float32, or None
        Linear.
    confidence : ndarray, shape (n,), or None
    """

    coverage: float
    photo: np.ndarray
    albedo: np.ndarray | None = None
    shading: np.ndarray | None = None
    confidence: np.ndarray | None = None

    def residual(self) -> float | None:
        """Compute median |I − ρ·S| over median I, of the mean of the channels."""
        if self.albedo is None or self.shading is None or not len(self.photo):
            return None
        seen, explained = self.photo.mean(axis=1), (self.albedo * self.shading).mean(axis=1)
        middle = float(np.median(seen))
        return float(np.median(np.abs(seen - explained))) / middle if middle > 0 else None

    def confident(self, least: float) -> float | None:
        """Compute the share of pixels whose confidence is at least so much."""
        if self.confidence is None or not len(self.confidence):
            return None
        return float((self.confidence >= least).mean())

    def as_json(self, least_confidence: float) -> dict[str, Any]:
        """Convert to plain JSON values."""
        return finite_or_null(
            {
                "coverage": self.coverage,
                "residual": self.residual(),
                "confident": self.confident(least_confidence),
            }
        )


def share_of_light(views: Sequence[SampledView], log_offset: float) -> float | None:
    """Compute the share of the photos' variation that is light: 1 − var log ρ / var log I, of all views.

    Notes
    -----
    Of the mean of the channels, log of value + `log_offset` of the mean. 1: the albedo is flat, all that
    varied was light; 0: the albedo varies as much as the photos. None without albedo.
    """
    if not views or any(view.albedo is None for view in views):
        return None
    albedo = _variance_of_log([view.albedo for view in views if view.albedo is not None], log_offset)
    photo = _variance_of_log([view.photo for view in views], log_offset)
    return 1 - albedo / photo if photo > 0 else None


def _variance_of_log(values: Sequence[np.ndarray], log_offset: float) -> float:
    grey = np.concatenate(values).mean(axis=1, dtype=np.float64)
    if not len(grey):
        return 0.0
    return float(np.log(np.maximum(grey, 0) + log_offset * max(grey.mean(), 1e-12)).var())
