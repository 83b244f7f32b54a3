"""Means over the corresponding pixels of other views."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stages.photometry.stack import StackedViews


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
        known = np.where(self.trusted[:, None], values, 0).astype(np.float32)
        return _sum_over_correspondences(self.views, known) / np.maximum(self.correspondences, 1)[:, None]

    def with_own(self, values: np.ndarray) -> np.ndarray:
        """Average over a pixel and its correspondences, (N, c), float32."""
        own = self.count[:, None]
        return np.where(own > 0, (values + own * self.mean(values)) / (1 + own), values).astype(np.float32)

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
    for (i, j), block in views.correspondences.items():
        one, other = views.view(i), views.view(j)
        total[one] += block @ values[other]
        total[other] += block.T @ values[one]
    return total
