"""All views of a set stacked into long vectors, as in Eq. 17; shared by the colour channels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from stages.formats.artefacts.view_files import Each, images_of
from stages.photometry.paper.harmonics import shading_basis
from stages.solvers.kernels.arrays_in_files import in_file
from stages.solvers.least_squares.correspondence_operator import (
    Correspondences,
    check_correspondences,
    correspondence_matrix,
    linked_pixels,
)
from stages.solvers.least_squares.difference_operators import (
    Pixels,
    difference_matrices,
    first_pixels,
    neighbours,
)
from stages.solvers.least_squares.reweighted_least_squares import NormalEquations, without_empty_rows

ALIGNED = 64  # px: crops begin at multiples, so that groups of pixels of any level are those of whole views


@dataclass(frozen=True, eq=False)
class StackedViews:
    """Geometry of all views over their N pixels: view after view, row by row. Read-only, shared by channels.

    Attributes
    ----------
    starts : ndarray, shape (n + 1,), int64
        View i owns the places ``starts[i]:starts[i + 1]``.
    basis : ndarray, shape (N, K) or (N, K, 3), float32
        ν of Eq. 1, K = 9 harmonics in `mode: paper`; one per channel where interreflection makes them
        differ.
    masks : tuple of ndarray, shape (h_i, w_i), bool
        Ω of every view.
    correspondences : mapping of (i, j), i < j, to csr_array, shape (|Ω^i|, |Ω^j|)
        C_ij.
    side_of_all : float or None
        `side` of the views that these are some of; None: they are all.
    """

    starts: np.ndarray
    basis: np.ndarray
    masks: tuple[np.ndarray, ...]
    correspondences: Correspondences
    side_of_all: float | None = None

    @property
    def view_count(self) -> int:
        """n, the number of views."""
        return self.starts.size - 1

    @property
    def correspondence_count(self) -> int:
        """Number of correspondences, over all pairs of views."""
        return sum(block.nnz for block in self.correspondences.values())

    @property
    def correspondences_per_pixel(self) -> float:
        """Mean number of correspondences per pixel."""
        return 2 * self.correspondence_count / max(int(self.starts[-1]), 1)

    @property
    def side(self) -> float:
        """Mean side of the views, taken as squares, px."""
        if self.side_of_all is not None:
            return self.side_of_all
        return float(np.mean([np.sqrt(mask.size) for mask in self.masks]))

    def view(self, i: int) -> slice:
        """Return the places of view i."""
        return slice(int(self.starts[i]), int(self.starts[i + 1]))

    def of_channel(self, channel: int) -> StackedViews:
        """Take the basis of one channel, shape (N, K)."""
        return self if self.basis.ndim == 2 else replace(self, basis=self.basis[:, :, channel])

    def positions(self) -> np.ndarray:
        """List row and column of every pixel in its own view, shape (N, 2), int32."""
        return np.concatenate([np.argwhere(mask).astype(np.int32) for mask in self.masks])

    def in_file(self, folder: Path) -> StackedViews:
        """Move the correspondences to a file in a folder; see `arrays_in_files`."""
        blocks = self.correspondences.values()
        arrays = in_file([part for block in blocks for part in _parts(block)], folder)
        moved = {
            pair: sp.csr_array(tuple(arrays[3 * k : 3 * k + 3]), shape=block.shape, copy=False)
            for k, (pair, block) in enumerate(self.correspondences.items())
        }
        return replace(self, correspondences=moved)

    def neighbours(self) -> Iterator[Pixels]:
        """Iterate over pairs of adjacent pixels: those of D_x, then those of D_y, view by view."""
        for mask, first in zip(self.masks, self.starts[:-1].tolist(), strict=True):
            yield from neighbours(mask, first)

    def linked_pixels(self) -> Iterator[Pixels]:
        """Iterate over pairs of corresponding pixels, pair of views by pair of views."""
        return linked_pixels(self.correspondences, self.starts)

    def linked_rows(self) -> Iterator[tuple[np.ndarray, np.ndarray, int, int]]:
        """Iterate over the pairs of views for compiled loops: C_ij's `indptr` and `indices`, first pixels."""
        for (i, j), block in sorted(self.correspondences.items()):
            yield block.indptr, block.indices, int(self.starts[i]), int(self.starts[j])

    def shading(self, light: np.ndarray) -> np.ndarray:
        """Evaluate ``S = σ^i·ν^i(p)`` of Eq. 1, all pixels, (N,), under one light per view, (n, K)."""
        # einsum rather than a BLAS product: the same bits whatever the number of threads.
        parts = [np.einsum("pk,k->p", self.basis[self.view(i)], light[i]) for i in range(self.view_count)]
        return np.concatenate(parts)

    def shadings(self, lights: np.ndarray) -> np.ndarray:
        """Evaluate S of every channel, shape (N, c), under lights of shape (n, c, K)."""
        channels = range(lights.shape[1])
        return np.stack([self.of_channel(c).shading(lights[:, c]) for c in channels], axis=-1)

    @cached_property
    def equations(self) -> NormalEquations:
        """Pattern of JᵀJ, computed on first use, as are the operators below, by `solver: paper` only."""
        return NormalEquations.of([self.d_x, self.d_y, self.c])

    @property
    def d_x(self) -> sp.csr_array:
        """D_x of Eq. 17 without its empty rows, shape (·, N), float64."""
        return self._differences[0]

    @property
    def d_y(self) -> sp.csr_array:
        """D_y, likewise."""
        return self._differences[1]

    @cached_property
    def c(self) -> sp.csr_array:
        """C of Eq. 18, likewise."""
        return without_empty_rows(correspondence_matrix(self.correspondences, np.diff(self.starts).tolist()))

    @cached_property
    def _differences(self) -> tuple[sp.csr_array, sp.csr_array]:
        d_x, d_y = difference_matrices(self.masks)
        return without_empty_rows(d_x), without_empty_rows(d_y)


def _parts(block: sp.csr_array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return block.data, block.indices, block.indptr


def stack_views(
    masks: Sequence[np.ndarray],
    normals_in_world: Sequence[np.ndarray] | None,
    correspondences: Correspondences,
    each: Each = map,
) -> StackedViews:
    """Stack the views.

    Parameters
    ----------
    masks : sequence of ndarray, shape (h_i, w_i), bool
        Ω of every view.
    normals_in_world : sequence of ndarray, shape (h_i, w_i, 3), or None
        Unit inside the mask. None for an empty basis, where the light is not of harmonics.
    correspondences : mapping of (i, j), i < j, to csr_array, shape (|Ω^i|, |Ω^j|)
        C_ij: at most one 1 per row. A pair that is absent has no correspondences.
    each : callable
        `map`, or that of an executor: view by view.

    Raises
    ------
    ValueError
        The correspondences are not of that kind.
    """
    starts = first_pixels(masks)
    check_correspondences(correspondences, np.diff(starts).tolist())
    if normals_in_world is None:
        return StackedViews(
            starts, np.empty((int(starts[-1]), 0), np.float32), tuple(masks), dict(correspondences)
        )

    def basis_of(view: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        normals, mask = view
        return shading_basis(normals[mask]).astype(np.float32)

    basis = np.concatenate(list(each(basis_of, zip(normals_in_world, masks, strict=True))))
    return StackedViews(starts=starts, basis=basis, masks=tuple(masks), correspondences=dict(correspondences))


def stack_pixels(masks: Sequence[np.ndarray], images: Sequence[np.ndarray]) -> np.ndarray:
    """Stack the values of all masked pixels, shape (N, …), float64, from one image (h_i, w_i, …) per view."""
    return np.concatenate([image[mask] for image, mask in zip(images, masks, strict=True)]).astype(np.float64)


def unstack_pixels(masks: Sequence[np.ndarray], stacked: np.ndarray) -> list[np.ndarray]:
    """Unstack all images at once; see `images_of`."""
    return list(images_of(masks, stacked))


def crop_origin(mask: np.ndarray) -> tuple[int, int]:
    """Find the row and column where a mask is cropped to what is in it: multiples of `ALIGNED`."""
    top, left = (int(np.flatnonzero(mask.any(axis=axis))[0]) // ALIGNED * ALIGNED for axis in (1, 0))
    return top, left


def cropped(mask: np.ndarray) -> np.ndarray:
    """Crop a mask to what is in it, from `crop_origin`: its pixels and their order stay."""
    top, left = crop_origin(mask)
    bottom, right = (int(np.flatnonzero(mask.any(axis=axis))[-1]) + 1 for axis in (1, 0))
    return np.ascontiguousarray(mask[top:bottom, left:right])
