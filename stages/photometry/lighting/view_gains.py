"""Relative exposure and white balance of the views, and the differences between views that remain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.lighting.settings import ViewGainSettings
from stages.photometry.neighbourhoods import PATCHES
from stages.photometry.stack import StackedViews

TO_DEVIATION = 1.4826  # median absolute to standard deviation, were the errors Gaussian


@dataclass(frozen=True, eq=False)
class ViewGains:
    """Gains of the views, and the spread of corresponding pixels after them.

    Attributes
    ----------
    gains : ndarray, shape (n, 3), float64
        Of every view and channel; geometric mean 1. Views without correspondences, and dark channels, have 1.
    spread : float
        Residual after the gains: the typical difference of the logarithms of two views' brightness in the
        same patch of surface. Noise alone gives some percent; moving light, or specular reflection on all
        surface (see `brightening`), much more. 0 without correspondences.
    """

    gains: np.ndarray
    spread: float


def view_gains(
    views: StackedViews, image: np.ndarray, trusted: np.ndarray, how: ViewGainSettings
) -> ViewGains:
    """Estimate the gain of every view and channel from corresponding pixels.

    Parameters
    ----------
    views : StackedViews
    image : ndarray, shape (N, 3)
        Linear, scaled to a 99th percentile of 1.
    trusted : ndarray, shape (N,), bool
        Pixels that count: neither clipped nor seen at a grazing angle.
    how : ViewGainSettings

    Notes
    -----
    1. For every pair of views and channel, the median of ``log I^i − log I^j`` over correspondences whose
       pixels are both brighter than `how.dark`. Under one static light diffuse surfaces have the same
       radiance in all views, so that only the gains differ.
    2. The log gains are the least-squares solution over all pairs, each weighted by its number of
       correspondences.
    3. The spread is measured on what the gains leave, averaged over patches: fine texture that is
       misregistered by half a pixel averages out, moving light does not.
    """
    floor = np.repeat(_floors(views, image, how), np.diff(views.starts), axis=0)
    logs, bright = np.log(np.maximum(image, floor)), trusted[:, None] & (image > floor)
    channels = ((logs[:, c], bright[:, c]) for c in range(3))
    gains = np.stack([_log_gains(views, *each, how.fewest_correspondences) for each in channels], axis=1)
    logs -= np.repeat(gains, np.diff(views.starts), axis=0)
    left = _left(views, logs, bright, how)
    spread = TO_DEVIATION * float(np.median(np.abs(left))) if left.size else 0.0
    return ViewGains(np.exp(gains), spread)


def _floors(views: StackedViews, image: np.ndarray, how: ViewGainSettings) -> np.ndarray:
    """Compute the threshold of dark pixels in every view and channel, (n, 3)."""
    bright = [
        np.percentile(image[views.view(k)], how.bright_percentile, axis=0)
        if np.diff(views.starts)[k]
        else np.zeros(3)
        for k in range(views.view_count)
    ]
    return np.clip(how.dark * np.array(bright), how.darkest, how.dark)


def _log_gains(
    views: StackedViews, logs: np.ndarray, bright: np.ndarray, fewest_correspondences: int
) -> np.ndarray:
    """Solve for the log gain of every view in one channel, (n,): 0 where it is dark."""
    rows, medians = [], []
    for (i, j), (one, other) in zip(sorted(views.correspondences), views.linked_pixels(), strict=True):
        both = bright[one] & bright[other]
        correspondences = np.count_nonzero(both)
        if correspondences < fewest_correspondences:
            continue
        row = np.zeros(views.view_count)
        row[i], row[j] = 1, -1
        rows.append(np.sqrt(correspondences) * row)
        medians.append(np.sqrt(correspondences) * np.median(logs[one[both]] - logs[other[both]]))
    return np.linalg.lstsq(rows, medians, rcond=None)[0] if rows else np.zeros(views.view_count)


def _left(views: StackedViews, logs: np.ndarray, bright: np.ndarray, how: ViewGainSettings) -> np.ndarray:
    """Average, per patch, the log differences of bright correspondences after the gains, (·,)."""
    patch, left = _patches(views), [np.zeros(0)]
    for one, other in views.linked_pixels():
        both = bright[one] & bright[other]
        some = both.any(axis=1)
        if np.count_nonzero(some) < how.fewest_correspondences:
            continue
        off = ((logs[one] - logs[other]) * both)[some].sum(axis=1) / both[some].sum(axis=1)
        left.append(_of_patches(patch[one[some]], off, how))
    return np.concatenate(left)


def _patches(views: StackedViews) -> np.ndarray:
    """Number the patch of its view that contains each pixel, (N,)."""
    size = max(1, round(views.side / PATCHES))
    rows, columns = (views.positions() // size).T.astype(np.int64)
    return rows * (int(columns.max(initial=0)) + 1) + columns


def _of_patches(patch: np.ndarray, values: np.ndarray, how: ViewGainSettings) -> np.ndarray:
    """Average values in every patch that holds enough, else in every patch that holds some, (·,)."""
    _, own, count = np.unique(patch, return_inverse=True, return_counts=True)
    values = np.clip(values, -how.largest_difference, how.largest_difference)
    means, enough = np.bincount(own.reshape(-1), values) / count, count >= how.fewest_correspondences_in_patch
    return means[enough] if enough.any() else means
