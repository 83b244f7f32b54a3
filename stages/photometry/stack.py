"""All views of a set stacked into long vectors, as in Eq. 17: what the colour channels share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from stages.photometry.harmonics import shading_basis
from stages.solvers.correspondence_operator import correspondence_matrix
from stages.solvers.difference_operators import difference_matrices
from stages.solvers.reweighted_least_squares import NormalEquations, without_empty_rows


@dataclass(frozen=True, eq=False)
class StackedViews:
    """Geometry of all views over their N pixels: view after view, row by row. Read-only, shared by channels.

    Attributes
    ----------
    starts : ndarray, shape (n + 1,), int64
        View i owns the places ``starts[i]:starts[i + 1]``.
    basis : ndarray, shape (N, 9), float64
        ν of Eq. 1.
    d_x, d_y, c : csr_array, shape (·, N), float64
        D_x, D_y and C of Eq. 17 without their empty rows.
    positions : ndarray, shape (N, 2), int32
        Row and column of every pixel in its own view.
    """

    starts: np.ndarray
    basis: np.ndarray
    d_x: sp.csr_array
    d_y: sp.csr_array
    c: sp.csr_array
    positions: np.ndarray

    @cached_property
    def equations(self) -> NormalEquations:
        """Pattern of JᵀJ, found when first asked for: only `solver: paper` assembles it."""
        return NormalEquations.of([self.d_x, self.d_y, self.c])

    @property
    def view_count(self) -> int:
        """n, the number of views."""
        return self.starts.size - 1

    def view(self, i: int) -> slice:
        """Places of view i."""
        return slice(int(self.starts[i]), int(self.starts[i + 1]))

    def shading(self, light: np.ndarray) -> np.ndarray:
        """``S = σ^i·ν^i(p)`` of all pixels, shape (N,), under one light per view, shape (n, 9)."""
        # einsum rather than a BLAS product: the same bits whatever the number of threads.
        parts = [np.einsum("pk,k->p", self.basis[self.view(i)], light[i]) for i in range(self.view_count)]
        return np.concatenate(parts)


def stack_views(
    masks: Sequence[np.ndarray],
    normals_in_world: Sequence[np.ndarray],
    links: Mapping[tuple[int, int], sp.csr_array],
) -> StackedViews:
    """Stack the views and build the operators of Eq. 17.

    Parameters
    ----------
    masks : sequence of ndarray, shape (h_i, w_i), bool
        Ω of every view.
    normals_in_world : sequence of ndarray, shape (h_i, w_i, 3)
        Unit inside the mask.
    links : mapping of (i, j), i < j, to csr_array, shape (|Ω^i|, |Ω^j|)
        C_ij.
    """
    counts = [int(np.count_nonzero(mask)) for mask in masks]
    basis = [shading_basis(normals[mask]) for normals, mask in zip(normals_in_world, masks, strict=True)]
    d_x, d_y = (without_empty_rows(d) for d in difference_matrices(masks))
    c = without_empty_rows(correspondence_matrix(links, counts))
    return StackedViews(
        starts=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        basis=np.concatenate(basis),
        d_x=d_x,
        d_y=d_y,
        c=c,
        positions=np.concatenate([np.argwhere(mask) for mask in masks]).astype(np.int32),
    )


def stack_pixels(masks: Sequence[np.ndarray], images: Sequence[np.ndarray]) -> np.ndarray:
    """Values of all masked pixels, shape (N, …), float64, from one image (h_i, w_i, …) per view."""
    return np.concatenate([image[mask] for image, mask in zip(images, masks, strict=True)]).astype(np.float64)


def unstack_pixels(masks: Sequence[np.ndarray], stacked: np.ndarray) -> list[np.ndarray]:
    """Images (h_i, w_i, …), float32, 0 outside the masks, from stacked values (N, …)."""
    images, start = [], 0
    for mask in masks:
        count = int(np.count_nonzero(mask))
        image = np.zeros((*mask.shape, *stacked.shape[1:]), np.float32)
        image[mask] = stacked[start : start + count]
        images.append(image)
        start += count
    return images
