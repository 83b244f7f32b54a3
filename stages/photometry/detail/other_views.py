"""Means over the corresponding pixels of other views."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.pixelwise import EVERYWHERE, Chosen
from stages.solvers.primal_dual.half_edges import from_edges, half_edges_of


@dataclass(frozen=True, eq=False)
class OtherViews:
    """Correspondences of pixels with trusted pixels of other views.

    Attributes
    ----------
    first : ndarray, shape (N + 1,), int64
        Those that correspond to pixel p are ``neighbour[first[p]:first[p + 1]]``.
    neighbour : ndarray, shape (H,), int32
    trusted : ndarray, shape (N,), bool
        Pixels that are averaged over.
    correspondences : ndarray, shape (N,), float32
        Number of trusted pixels that correspond to each pixel: a coarse pixel may have several in one view.
    """

    first: np.ndarray
    neighbour: np.ndarray
    trusted: np.ndarray
    correspondences: np.ndarray

    @classmethod
    def of(cls, views: StackedViews, trusted: np.ndarray) -> OtherViews:
        """Count the correspondences with trusted pixels."""
        first, neighbour = _links(views)
        return cls(first, neighbour, trusted, _count(first, neighbour, trusted))

    @cached_property
    def count(self) -> np.ndarray:
        """Number of correspondences of the trusted pixels, (N,), float32; 0 for the others."""
        return np.where(self.trusted, self.correspondences, 0).astype(np.float32)

    @cached_property
    def numbers(self) -> np.ndarray:
        """Numbers of all pixels, (N,), int32."""
        return np.arange(len(self.trusted), dtype=np.int32)

    def mean(self, values: np.ndarray, at: Chosen = EVERYWHERE) -> np.ndarray:
        """Average over what corresponds to n pixels, (n, c), float32; 0 where nothing does."""
        return _average(self.numbers[at], self.first, self.neighbour, self.trusted, values, False)

    def with_own(self, values: np.ndarray, at: Chosen = EVERYWHERE) -> np.ndarray:
        """Average over n pixels and what corresponds to each, (n, c), float32; untrusted ones keep theirs."""
        return _average(self.numbers[at], self.first, self.neighbour, self.trusted, values, True)

    def around(self, pixels: np.ndarray) -> np.ndarray:
        """List n pixels and all that correspond to them, ascending."""
        marked = np.zeros(len(self.trusted), bool)
        marked[pixels] = marked[self.neighbour[half_edges_of(self.first, pixels)]] = True
        return np.flatnonzero(marked)

    def filled_in(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Fill in untrusted pixels from corresponding ones: highlights, passers-by, grazing angles.

        Parameters
        ----------
        values : ndarray, shape (N, c)
            A property of the surface, equal in all views.

        Returns
        -------
        tuple of ndarray, shape (N, c), float32, and ndarray, shape (N,), bool
            The values, for untrusted pixels the mean over the corresponding trusted ones; and a mask of the
            pixels that have a value.
        """
        filled = ~self.trusted & (self.correspondences > 0)
        values = np.where(filled[:, None], self.mean(values), values)
        return values.astype(np.float32), self.trusted | filled


def _links(views: StackedViews) -> tuple[np.ndarray, np.ndarray]:
    """List the corresponding pixels of every pixel: as `first` and `neighbour` of `OtherViews`."""
    none = np.zeros(0, np.int32)
    ends = zip((none, none), *views.linked_pixels(), strict=True)
    tail, head = (np.concatenate(pixels) for pixels in ends)
    links = from_edges(int(views.starts[-1]), tail, head, np.ones(len(tail), np.float32))
    return links.first, links.neighbour


@numba.njit(parallel=True, cache=True, nogil=True)
def _count(first, neighbour, known):
    """Count the known neighbours of every pixel, (N,), float32."""
    count = np.zeros(first.size - 1, np.float32)
    for pixel in numba.prange(first.size - 1):
        p = np.int64(pixel)
        for k in range(first[p], first[p + 1]):
            count[p] += known[neighbour[k]]
    return count


@numba.njit(parallel=True, cache=True, nogil=True)
def _average(pixels, first, neighbour, known, values, with_own):
    """Average the known neighbours' values of n pixels, (n, c); and, where asked, a known pixel's own."""
    mean = np.empty((pixels.size, values.shape[1]), np.float32)
    for i in numba.prange(pixels.size):
        p = np.int64(pixels[i])
        count = np.float32(0)
        for c in range(values.shape[1]):
            mean[i, c] = values[p, c] if with_own else 0
        if with_own and not known[p]:
            continue
        for k in range(first[p], first[p + 1]):
            other = neighbour[k]
            if known[other]:
                count += 1
                for c in range(values.shape[1]):
                    mean[i, c] += values[other, c]
        count = max(count + with_own, np.float32(1))
        for c in range(values.shape[1]):
            mean[i, c] /= count
    return mean
