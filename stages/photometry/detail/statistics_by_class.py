"""Statistics of pixels in classes of equal number, sorted by a measure of size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from stages.photometry.detail.settings import ClassSettings

MAD = 0.6745  # median absolute value of a standard normal deviate


def by_size(size: np.ndarray, classes: ClassSettings) -> list[np.ndarray]:
    """Sort pixels, (n,), into classes of equal number, smallest first; returns their indices.

    Few pixels make fewer classes.
    """
    count = min(classes.most, len(size) // classes.fewest_pixels)
    return np.array_split(np.argsort(size, kind="stable"), count) if count else []


def deviation(values: np.ndarray) -> float:
    """Estimate a standard deviation from the median absolute value, robust to outliers."""
    return float(np.median(np.abs(values))) / MAD if values.size else 0.0


@dataclass(frozen=True)
class Line:
    """``variance ≈ intercept + slope · strength``, both at least 0, and the slope's standard error."""

    intercept: float
    slope: float
    error: float


def line_through(strengths: list[float], variances: list[float], floor: float) -> Line | None:
    """Fit a line to classes by non-negative least squares over relative errors; None for fewer than three.

    Parameters
    ----------
    strengths, variances : list of float
        Per class.
    floor : float
        Added to the variance that errors are relative to.
    """
    count = len(variances)
    if count < 3:
        return None
    strength, variance = (np.array(each, np.float64) for each in (strengths, variances))
    relative = 1 / (variance + floor)
    design = np.stack([np.ones(count), strength], axis=1) * relative[:, None]
    (intercept, slope), left = nnls(design, variance * relative)
    scatter = left**2 / max(count - 2, 1)
    error = np.sqrt(np.linalg.pinv(design.T @ design)[1, 1] * scatter)
    return Line(float(intercept), float(slope), float(error))
