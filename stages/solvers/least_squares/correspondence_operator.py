"""C of Eq. 18: differences of albedo between corresponding pixels of two views."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np
import scipy.sparse as sp

Correspondences = Mapping[tuple[int, int], sp.csr_array]


def linked_pixels(
    correspondences: Correspondences, starts: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Iterate over the pairs of views in the order of Eq. 18, yielding their corresponding pixels.

    Parameters
    ----------
    correspondences : mapping of (i, j), i < j, to csr_array, shape (|Ω^i|, |Ω^j|)
        C_ij: at most one 1 per row.
    starts : ndarray, shape (n + 1,), int64
        View i owns the numbers ``starts[i]:starts[i + 1]``.

    Yields
    ------
    tuple of two ndarray, shape (·,), int32
        Numbers of the pixels in view i and in view j.
    """
    for i, j in sorted(correspondences):
        block = correspondences[i, j]
        linked = np.flatnonzero(np.diff(block.indptr))
        yield (linked + starts[i]).astype(np.int32), (block.indices + starts[j]).astype(np.int32)


def correspondence_matrix(correspondences: Correspondences, pixel_counts: Sequence[int]) -> sp.csr_array:
    """Assemble the block matrix of all pairs; for four views

    Eq. 18: ``C = [B12 C12 . . ; B13 . C13 . ; B14 . . C14 ; . B23 C23 . ; . B24 . C24 ; . . B34 C34]``.

    Parameters
    ----------
    correspondences : mapping of (i, j), i < j, to csr_array, shape (|Ω^i|, |Ω^j|)
        C_ij: at most one 1 per row. A pair that is absent has no correspondences.
    pixel_counts : sequence of int
        |Ω^i| of every view; N together.

    Returns
    -------
    csr_array, shape (Σ_i (n − i) |Ω^i|, N), float64
        Block rows in the order (1, 2), (1, 3), … (n − 1, n). B_ij is diagonal with −1 on the rows where
        C_ij has its 1, so that a row gives ``ρ^j(p^j) − ρ^i(p^i)``; the other rows are empty.

    Raises
    ------
    ValueError
        A pair is not i < j, a block has the wrong shape, or a row has more than one correspondence.
    """
    starts = np.concatenate([[0], np.cumsum(pixel_counts)])
    check_correspondences(correspondences, pixel_counts)
    shape = (sum(pixel_counts[i] for i, _ in combinations(range(len(pixel_counts)), 2)), int(starts[-1]))
    if not correspondences:
        return sp.csr_array(shape, dtype=np.float64)
    pairs = list(linked_pixels(correspondences, starts))
    firsts = _first_rows(pixel_counts)
    rows = [
        one - starts[i] + firsts[i, j]
        for (one, _), (i, j) in zip(pairs, sorted(correspondences), strict=True)
    ]
    here, there = (np.concatenate(side) for side in zip(*pairs, strict=True))
    entries = np.tile(np.concatenate(rows), 2), np.concatenate([here, there])
    return sp.csr_array((np.repeat([-1.0, 1.0], here.size), entries), shape=shape)


def _first_rows(pixel_counts: Sequence[int]) -> dict[tuple[int, int], int]:
    """Compute the first block row of every pair."""
    pairs = list(combinations(range(len(pixel_counts)), 2))
    ends = np.cumsum([pixel_counts[i] for i, _ in pairs]).tolist()
    return dict(zip(pairs, [0, *ends], strict=False))


def check_correspondences(correspondences: Correspondences, pixel_counts: Sequence[int]) -> None:
    """Validate correspondences for Eq. 18.

    Raises
    ------
    ValueError
        A pair is not i < j, a block has the wrong shape, or a row has more than one correspondence.
    """
    for (i, j), block in correspondences.items():
        if not 0 <= i < j < len(pixel_counts):
            raise ValueError(f"Pair ({i}, {j}) among {len(pixel_counts)} views; expected i < j.")
        expected = (pixel_counts[i], pixel_counts[j])
        if block.shape != expected:
            raise ValueError(f"C of pair ({i}, {j}) has shape {block.shape}; expected {expected}.")
        if np.any(np.diff(block.indptr) > 1):
            raise ValueError(f"C of pair ({i}, {j}) has a row with more than one correspondence.")
