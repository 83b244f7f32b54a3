"""A pyramid of Eq. 2: pixels in groups of 2×2 within their view."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from stages.solvers.primal_dual.half_edges import HalfEdges, aggregated


@dataclass(frozen=True, eq=False)
class Level:
    """Eq. 2 over some pixels, or over groups of them that share one albedo.

    Attributes
    ----------
    starts : ndarray, shape (n + 1,), int64
    positions : ndarray, shape (N, 2), int32
        Row and column within the view, at this level's size.
    basis : ndarray, shape (N, K, 1 or 3), float32
        ν, shared by the channels or one per channel.
    image : ndarray, shape (N, 3), float32
    share : ndarray, shape (N,), float32
        Filled share of every group: 1 where no pixel is missing.
    graph : HalfEdges
        Its weights include λ and μ.
    gauge_of_view : ndarray, shape (n,), int64
        Equal for views that correspondences connect.
    group : ndarray, shape (N of the finer level,), int32, or None
        Group of every pixel of the next finer level; None at the finest.
    """

    starts: np.ndarray
    positions: np.ndarray
    basis: np.ndarray
    image: np.ndarray
    share: np.ndarray
    graph: HalfEdges
    gauge_of_view: np.ndarray
    group: np.ndarray | None = None

    @property
    def pixels(self) -> int:
        """N, the number of pixels or groups."""
        return int(self.starts[-1])

    @property
    def view_of_pixel(self) -> np.ndarray:
        """Index of the view of every pixel, shape (N,)."""
        return np.repeat(np.arange(self.starts.size - 1), np.diff(self.starts))


def coarser(level: Level) -> Level:
    """Build the next coarser level, of groups of up to 2×2 pixels.

    Sums are divided by four, so that the same step sizes suit all levels. The data term of a full group and
    the consistency keep their weight, the smoothness has half.
    """
    half = level.positions // 2
    starts, group = _groups(half, level.starts)
    count = int(starts[-1])
    positions = np.empty((count, 2), np.int32)
    positions[group] = half
    return Level(
        starts=starts,
        positions=positions,
        basis=_quarter_sums(group, level.basis.reshape(len(group), -1), count).reshape(
            count, *level.basis.shape[1:]
        ),
        image=_quarter_sums(group, level.image, count),
        share=_quarter_sums(group, level.share[:, None], count)[:, 0],
        graph=aggregated(level.graph, group, count, factor=1 / 4),
        gauge_of_view=level.gauge_of_view,
        group=group,
    )


def pyramid(finest: Level, fewest: int, most: int | None = None) -> list[Level]:
    """Build all levels, coarsest first; none has fewer than `fewest` pixels per view on average.

    With a number of `most` coarser levels, as many as that, however few pixels they have.
    """
    levels, enough = [finest], 4 * fewest * (finest.starts.size - 1)
    while levels[0].pixels >= enough if most is None else len(levels) <= most:
        levels.insert(0, coarser(levels[0]))
    return levels


def _groups(half: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number the occupied places, view after view, row by row: starts (n + 1,), group (N,)."""
    group, counts = np.empty(len(half), np.int32), list[int]()
    for begin, end in zip(starts[:-1], starts[1:], strict=True):
        rows, columns = half[begin:end].T
        wide = int(columns.max(initial=-1)) + 1
        code = rows * wide + columns
        taken = np.zeros(int(code.max(initial=-1)) + 1, bool)
        taken[code] = True
        group[begin:end] = (np.cumsum(taken, dtype=np.int32) - 1)[code] + sum(counts)
        counts.append(int(np.count_nonzero(taken)))
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), group


def _quarter_sums(group: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Sum values (N, k) over the groups, divided by four; (count, k), float32."""
    sums = np.zeros((count, values.shape[1]))
    _add_up(group, values, sums)
    sums /= 4
    return sums.astype(np.float32)


@numba.njit(cache=True, nogil=True)
def _add_up(group, values, sums):
    for p in range(group.size):
        for k in range(values.shape[1]):
            sums[group[p], k] += values[p, k]
