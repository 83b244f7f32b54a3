"""Sliced ELLPACK layout: pixels in slices of eight, for SIMD loops."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
import scipy.sparse as sp

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.solvers.kernels.simd import COUNT

# Index constants of compiled loops. Unsigned throughout: numba checks signed indices for negative values.
ZERO, ONE, THREE = np.uint64(0), np.uint64(1), np.uint64(3)
EIGHT, SIXTEEN, SLICE = np.uint64(8), np.uint64(16), np.uint64(24)  # a slice: three channels of eight pixels
QUADS = np.uint64(32)  # a slice of an interleaved array: eight pixels of four numbers

BLOCK = 128  # slices per task of a thread; the order of sums depends on it alone


@dataclass(frozen=True, eq=False)
class Slices:
    """Pixels of every view in slices of eight; a view's last slice is padded.

    Values of k kinds per pixel, (N, k), are stored as (S, k, 8): kind by kind within a slice.

    Attributes
    ----------
    starts : ndarray, shape (n + 1,), int64
        View i owns the pixels ``starts[i]:starts[i + 1]``.
    first : ndarray, shape (n + 1,), int64
        View i owns the slices ``first[i]:first[i + 1]``.
    places : ndarray, shape (N,), int32
        Pixel p is lane ``place % 8`` of slice ``place // 8``.
    """

    starts: np.ndarray
    first: np.ndarray
    places: np.ndarray

    @classmethod
    def of(cls, starts: np.ndarray, rank: np.ndarray | None = None) -> Slices:
        """Fill slices with pixels in the order of a rank, (N,), int32: a permutation within the views.

        Without a rank the order is kept. The array is overwritten and becomes the places.
        """
        first = np.concatenate([[0], np.cumsum(-(-np.diff(starts) // COUNT))]).astype(np.int64)
        places = np.arange(starts[-1], dtype=np.int32) if rank is None else rank
        for begin, end, own in zip(starts[:-1], starts[1:], first[:-1], strict=True):
            places[begin:end] += np.int32(COUNT * own - begin)
        return cls(starts, first, places)

    @property
    def pixels(self) -> int:
        """N, the number of pixels."""
        return int(self.starts[-1])

    @property
    def count(self) -> int:
        """S, the number of slices."""
        return int(self.first[-1])

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Lay out values (N, k) as (S, k, 8), float32; 0 where no pixel is."""
        sliced = np.zeros((self.count, values.shape[1], COUNT), np.float32)
        _spread(np.ascontiguousarray(values, np.float32), self.places, sliced)
        return sliced

    def spread_numbers(self, numbers: np.ndarray) -> np.ndarray:
        """Lay out numbers (N,) of pixels as (S · 8,), int32; −1 where no pixel is."""
        spread = np.full(COUNT * self.count, -1, np.int32)
        spread[self.places] = numbers
        return spread

    def spread_basis(self, basis: np.ndarray) -> np.ndarray:
        """Lay out ν, (N, K) or (N, K, 1 or 3), as (S, K, 1 or 3, 8)."""
        kinds = int(np.prod(basis.shape[2:]))
        return self.spread(basis.reshape(len(basis), -1)).reshape(self.count, basis.shape[1], kinds, COUNT)

    def collect(self, sliced: np.ndarray) -> np.ndarray:
        """Collect values (S, k, 8) as (N, k)."""
        values = np.empty((self.places.size, sliced.shape[1]), sliced.dtype)
        for kind in range(sliced.shape[1]):
            values[:, kind] = sliced[:, kind].ravel()[self.places]
        return values

    @cached_property
    def blocks(self) -> Blocks:
        """Tasks of the threads: runs of at most `BLOCK` slices, none across two views."""
        views, begins = [], []
        for number in range(len(self.first) - 1):
            own = np.arange(self.first[number], self.first[number + 1], BLOCK)
            views.append(np.full(own.size, number))
            begins.append(own)
        view, begin = np.concatenate(views), np.concatenate(begins)
        return Blocks(len(self.first) - 1, view, begin, np.minimum(begin + BLOCK, self.first[view + 1]))


@dataclass(frozen=True, eq=False)
class Blocks:
    """Runs of slices.

    Attributes
    ----------
    view_count : int
    view, begin, end : ndarray, shape (B,), int64
        Block b takes the slices ``begin[b]:end[b]``, of one view.
    """

    view_count: int
    view: np.ndarray
    begin: np.ndarray
    end: np.ndarray

    @cached_property
    def _membership(self) -> sp.csr_array:
        ones, places = np.ones(self.view.size), (self.view, np.arange(self.view.size))
        return sp.csr_array((ones, places), shape=(self.view_count, self.view.size))

    def by_view(self, sums: np.ndarray) -> np.ndarray:
        """Sum values of every block, (B, …), per view, (n, …)."""
        return (self._membership @ sums.reshape(len(sums), -1)).reshape(self.view_count, *sums.shape[1:])


@numba.njit(parallel=True, cache=True, nogil=True)
def _spread(values, places, sliced):
    for pixel in numba.prange(places.size):
        p = np.int64(pixel)
        slice_, lane = places[p] // COUNT, places[p] % COUNT
        for kind in range(values.shape[1]):
            sliced[slice_, kind, lane] = values[p, kind]


@numba.njit(inline="always")
def held_at(place, channel):
    """Compute the flat index of a place's channel in rows of three channels of eight."""
    return place // 8 * 24 + place % 8 + 8 * channel
