"""Statistics of pixels in classes of equal number, sorted by some size."""

from __future__ import annotations

import numpy as np

CLASSES = 16
FEWEST = 100  # pixels of a class that are worth a word
MAD = 0.6745  # of a normal deviate: what half of all stay below


def by_size(size: np.ndarray) -> list[np.ndarray]:
    """Sort pixels, (n,), into classes of equal number, the smallest first: their numbers; few make fewer."""
    count = min(CLASSES, len(size) // FEWEST)
    return np.array_split(np.argsort(size, kind="stable"), count) if count else []


def deviation(values: np.ndarray) -> float:
    """Standard deviation of normal deviates, by the median of their sizes: the outlying do not count."""
    return float(np.median(np.abs(values))) / MAD if values.size else 0.0
