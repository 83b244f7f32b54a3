"""Means over the corresponding pixels of other views."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from stages.photometry.stack import StackedViews
from stages.solvers.kernels.pixelwise import on_threads, pixelwise


@dataclass(frozen=True, eq=False)
class OtherViews:
    """Correspondences of pixels with trusted pixels of other views.

    Attributes
    ----------
    views : StackedViews
    trusted : ndarray, shape (N,), bool
        Pixels that are averaged over.
    correspondences : ndarray, shape (N,), float32
        Number of trusted pixels that correspond to each pixel: a coarse pixel may have several in one view.
    """

    views: StackedViews
    trusted: np.ndarray
    correspondences: np.ndarray

    @classmethod
    def of(cls, views: StackedViews, trusted: np.ndarray) -> OtherViews:
        """Count the correspondences with trusted pixels."""
        return cls(views, trusted, _sum_over_correspondences(views, trusted.astype(np.float32)))

    @cached_property
    def count(self) -> np.ndarray:
        """Number of correspondences of the trusted pixels, (N,), float32; 0 for the others."""
        return np.where(self.trusted, self.correspondences, 0).astype(np.float32)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Average over the corresponding pixels, (N, c), float32; 0 where there is none."""
        total = _sum_over_correspondences(self.views, pixelwise(_values_where, self.trusted, values))
        total /= np.maximum(self.correspondences, 1)[:, None]
        return total

    def with_own(self, values: np.ndarray) -> np.ndarray:
        """Average over a pixel and its correspondences, (N, c), float32."""
        return pixelwise(_mean_with_others, values, self.count, self.mean(values))

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


def _sum_over_correspondences(views: StackedViews, values: np.ndarray) -> np.ndarray:
    """Sum the values of all corresponding pixels, shape as `values`, float32."""
    total = np.zeros_like(values)
    linked: list[list[tuple[sp.csr_array | sp.csc_array, int]]] = [[] for _ in range(views.view_count)]
    for (i, j), block in views.correspondences.items():
        linked[i].append((block, j))
        linked[j].append((block.T, i))

    def sum_view(number: int) -> None:
        for block, other in linked[number]:
            total[views.view(number)] += block @ values[views.view(other)]

    on_threads(sum_view, range(views.view_count))
    return total


def _values_where(known: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.where(known[:, None], values, 0).astype(np.float32)


def _mean_with_others(values: np.ndarray, count: np.ndarray, others: np.ndarray) -> np.ndarray:
    own = count[:, None]
    return np.where(own > 0, (values + own * others) / (1 + own), values).astype(np.float32)
