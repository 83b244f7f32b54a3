"""Relative exposure and white balance of the views, and the differences between views that remain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.photometry.lighting.settings import ViewGainSettings
from stages.photometry.neighbourhoods import PATCHES
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.pixelwise import on_threads

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


@dataclass(frozen=True, eq=False)
class LogView:
    """Logarithms of a view's pixels, (N_i, 3), and which of them are bright and trusted, (N_i, 3), bool."""

    logs: np.ndarray
    bright: np.ndarray

    @classmethod
    def of(cls, image: np.ndarray, trusted: np.ndarray, how: ViewGainSettings) -> LogView:
        """Take the logarithm of an image, (N_i, 3), above a floor by its bright pixels."""
        bright = np.percentile(image, how.bright_percentile, axis=0) if len(image) else np.zeros(3)
        floor = np.clip(how.dark * bright, how.darkest, how.dark)
        return cls(np.log(np.maximum(image, floor)), trusted[:, None] & (image > floor))


@dataclass(frozen=True, eq=False)
class PairRatio:
    """Median logarithm of view i over view j, (3,), and the number of correspondences it is of, (3,).

    Channels with too few have a number of 0.
    """

    i: int
    j: int
    medians: np.ndarray
    counts: np.ndarray

    @classmethod
    def of(
        cls, i: int, j: int, one: LogView, other: LogView, here: np.ndarray, there: np.ndarray, fewest: int
    ) -> PairRatio:
        """Compare the corresponding pixels `here`, (m,), of one view and `there` of the other."""
        both = one.bright[here] & other.bright[there]
        counts, medians = both.sum(axis=0), np.zeros(3)
        for c in np.flatnonzero(counts >= fewest):
            own = both[:, c]
            medians[c] = np.median(one.logs[here[own], c] - other.logs[there[own], c])
        return cls(i, j, medians, np.where(counts >= fewest, counts, 0))


def log_gains(
    view_count: int, ratios: Sequence[PairRatio], exposures: np.ndarray | None = None
) -> np.ndarray:
    """Solve for the log gains of all views, (n, 3): least squares over the pairs, weighted by number.

    Of all solutions the one nearest to the logarithms of the exposures, (n,): they decide between views that
    no chain of pairs connects. Without exposures these are alike.
    """
    start = np.zeros(view_count) if exposures is None else np.log(exposures)
    gains = np.repeat(start[:, None], 3, axis=1)
    for c in range(3):
        rows, values = [], []
        for ratio in ratios:
            if ratio.counts[c]:
                row = np.zeros(view_count)
                row[ratio.i], row[ratio.j] = 1, -1
                rows.append(np.sqrt(ratio.counts[c]) * row)
                values.append(np.sqrt(ratio.counts[c]) * (ratio.medians[c] - start[ratio.i] + start[ratio.j]))
        if rows:
            gains[:, c] += np.linalg.lstsq(rows, values, rcond=None)[0]
    return gains


def view_gains(
    views: StackedViews,
    image: np.ndarray,
    trusted: np.ndarray,
    how: ViewGainSettings,
    known: np.ndarray | None = None,
    exposures: np.ndarray | None = None,
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
    known : ndarray, shape (n, 3), or None
        Gains that were estimated from more views; the spread alone is measured then.
    exposures : ndarray, shape (n,), or None
        Of the views, relative, by their photos' EXIF data: see `log_gains`.

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
    own = [LogView.of(image[views.view(k)], trusted[views.view(k)], how) for k in range(views.view_count)]
    if known is None:
        gains = log_gains(views.view_count, _ratios(views, own, how.fewest_correspondences), exposures)
    else:
        gains = np.log(known)
    logs, bright = np.concatenate([one.logs for one in own]), np.concatenate([one.bright for one in own])
    del own
    logs -= np.repeat(gains, np.diff(views.starts), axis=0)
    left = _left(views, logs, bright, how)
    spread = TO_DEVIATION * float(np.median(np.abs(left))) if left.size else 0.0
    return ViewGains(np.exp(gains), spread)


def _ratios(views: StackedViews, logs: Sequence[LogView], fewest: int) -> list[PairRatio]:
    """Compare all pairs of views."""

    def ratio(pair: tuple[int, int]) -> PairRatio:
        (i, j), block = pair, views.correspondences[pair]
        linked = np.flatnonzero(np.diff(block.indptr))
        return PairRatio.of(i, j, logs[i], logs[j], linked, block.indices, fewest)

    return on_threads(ratio, sorted(views.correspondences))


def _left(views: StackedViews, logs: np.ndarray, bright: np.ndarray, how: ViewGainSettings) -> np.ndarray:
    """Average, per patch, the log differences of bright correspondences after the gains, (·,)."""
    patch = _patches(views)

    def left(pair: tuple[np.ndarray, np.ndarray, int, int]) -> np.ndarray:
        ends, columns, here, there = pair
        one, other = here + np.flatnonzero(np.diff(ends)), there + columns
        both = bright[one] & bright[other]
        some = both.any(axis=1)
        if np.count_nonzero(some) < how.fewest_correspondences:
            return np.zeros(0)
        off = ((logs[one] - logs[other]) * both)[some].sum(axis=1) / both[some].sum(axis=1)
        return _of_patches(patch[one[some]], off, how)

    return np.concatenate([np.zeros(0), *on_threads(left, views.linked_rows())])


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
