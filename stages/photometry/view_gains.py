"""Exposure and white balance of the views against each other, and whether one light explains them all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.neighbourhoods import PATCHES
from stages.photometry.stack import StackedViews

DARK = 0.02  # of the scaled image: ratios of darker values are noise
FEWEST = 50  # links of a pair of views that a median is trusted of
FEWEST_IN_PATCH = 5  # links
TO_DEVIATION = 1.4826  # median absolute to standard deviation, were the errors Gaussian


@dataclass(frozen=True, eq=False)
class ViewGains:
    """What the same surface shows in different views.

    Attributes
    ----------
    gains : ndarray, shape (n, 3), float64
        Of every view and channel; geometric mean 1. Views without links have 1.
    spread : float
        What is left after the gains: the typical difference of the logarithms of two views' brightness in
        the same patch of surface. Noise makes it some percent; light that moves, or gloss all over
        (see `brightening`), much more. 0 without links.
    """

    gains: np.ndarray
    spread: float


def view_gains(views: StackedViews, image: np.ndarray, trusted: np.ndarray) -> ViewGains:
    """Compare linked pixels of scaled images, (N, 3), as far as both are trusted, (N,), bool.

    Notes
    -----
    For every pair of views the median over its links of ``log I^i − log I^j``; the gains are the
    least-squares solution over all pairs, weighted by the root of their links. Under one static light, matt
    surface shows the same to all views, so that nothing but the gains is left. Fine paint, half a pixel
    off, is no sign of moving light: differences count by their mean over patches.
    """
    logs = np.log(np.maximum(image, DARK))
    bright = trusted & (image > DARK).all(axis=1)
    patch = _patches(views)
    rows, medians, differences = [], [], []
    for (i, j), block in views.links.items():
        one, other = (side + views.starts[k] for side, k in zip(block.nonzero(), (i, j), strict=True))
        both = bright[one] & bright[other]
        if np.count_nonzero(both) < FEWEST:
            continue
        difference = logs[one[both]] - logs[other[both]]
        row = np.zeros(views.view_count)
        row[i], row[j] = 1, -1
        rows.append(np.sqrt(len(difference)) * row)
        medians.append(np.sqrt(len(difference)) * np.median(difference, axis=0))
        differences.append((i, j, _of_patches(patch[one[both]], difference.mean(axis=1))))
    if not rows:
        return ViewGains(np.ones((views.view_count, 3)), 0.0)
    gains = np.linalg.lstsq(np.array(rows), np.array(medians), rcond=None)[0]
    left = [d - (gains[i] - gains[j]).mean() for i, j, d in differences]
    spread = TO_DEVIATION * float(np.median(np.abs(np.concatenate(left))))
    return ViewGains(np.exp(gains), spread)


def _patches(views: StackedViews) -> np.ndarray:
    """Number of the patch of its view that every pixel is in, (N,)."""
    size = max(1, round(views.side / PATCHES))
    rows, columns = (views.positions() // size).T.astype(np.int64)
    return rows * (int(columns.max(initial=0)) + 1) + columns


def _of_patches(patch: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Means of the values in every patch that holds some, (·,)."""
    _, own, count = np.unique(patch, return_inverse=True, return_counts=True)
    means = np.bincount(own.reshape(-1), np.clip(values, -1, 1)) / count
    return means[count >= FEWEST_IN_PATCH] if (count >= FEWEST_IN_PATCH).any() else means
