"""Exposure and white balance of the views against each other, and whether one light explains them all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.stack import StackedViews

DARK = 0.02  # of the scaled image: ratios of darker values are noise
FEWEST = 50  # links of a pair of views that a median is trusted of
TO_DEVIATION = 1.4826  # median absolute to standard deviation, were the errors Gaussian


@dataclass(frozen=True, eq=False)
class ViewGains:
    """What the same surface shows in different views.

    Attributes
    ----------
    gains : ndarray, shape (n, 3), float64
        Of every view and channel; geometric mean 1. Views without links have 1.
    spread : float
        What is left after the gains: the typical difference of the logarithms of two views' brightness at
        the same surface point. Noise and gloss make it some percent; light that moves, much more. 0
        without links.
    """

    gains: np.ndarray
    spread: float


def view_gains(views: StackedViews, image: np.ndarray) -> ViewGains:
    """Compare linked pixels of scaled images, (N, 3).

    Notes
    -----
    For every pair of views the median over its links of ``log I^i − log I^j``; the gains are the
    least-squares solution over all pairs, weighted by the root of their links. Under one static light, matt
    surface shows the same to all views, so that nothing but the gains is left.
    """
    logs = np.log(np.maximum(image, DARK))
    bright = (image > DARK).all(axis=1)
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
        differences.append((i, j, difference.mean(axis=1)))
    if not rows:
        return ViewGains(np.ones((views.view_count, 3)), 0.0)
    gains = np.linalg.lstsq(np.array(rows), np.array(medians), rcond=None)[0]
    left = [d - (gains[i] - gains[j]).mean() for i, j, d in differences]
    spread = TO_DEVIATION * float(np.median(np.abs(np.concatenate(left))))
    return ViewGains(np.exp(gains), spread)
