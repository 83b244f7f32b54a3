"""C of Eq. 18: differences of albedo between pixels of two views that show the same surface point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import scipy.sparse as sp


def correspondence_matrix(
    links: Mapping[tuple[int, int], sp.csr_array], pixel_counts: Sequence[int]
) -> sp.csr_array:
    """Arrange the pairs' matrices by block; for four views

    Eq. 18: ``C = [B12 C12 . . ; B13 . C13 . ; B14 . . C14 ; . B23 C23 . ; . B24 . C24 ; . . B34 C34]``.

    Parameters
    ----------
    links : mapping of (i, j), i < j, to csr_array, shape (|Ω^i|, |Ω^j|)
        C_ij: at most one 1 per row. A pair that is absent has no links.
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
        A pair is not i < j, a block has the wrong shape, or a row has more than one link.
    """
    starts = np.concatenate([[0], np.cumsum(pixel_counts)])
    rows, columns, values, first_row = [], [], [], 0
    _check_pairs(links, pixel_counts)
    for i, j in combinations(range(len(pixel_counts)), 2):
        if (i, j) in links:
            block = links[i, j].tocoo()
            linked, partner = block.coords
            rows += [first_row + linked, first_row + linked]
            columns += [starts[i] + linked, starts[j] + partner]
            values += [np.full(linked.size, -1.0), np.ones(linked.size)]
        first_row += pixel_counts[i]
    shape = (first_row, int(starts[-1]))
    if not rows:
        return sp.csr_array(shape, dtype=np.float64)
    stacked = (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_array((np.concatenate(values), stacked), shape=shape)


def _check_pairs(links: Mapping[tuple[int, int], sp.csr_array], pixel_counts: Sequence[int]) -> None:
    for (i, j), block in links.items():
        if not 0 <= i < j < len(pixel_counts):
            raise ValueError(f"Pair ({i}, {j}) among {len(pixel_counts)} views; expected i < j.")
        expected = (pixel_counts[i], pixel_counts[j])
        if block.shape != expected:
            raise ValueError(f"C of pair ({i}, {j}) has shape {block.shape}; expected {expected}.")
        if np.any(np.diff(block.indptr) > 1):
            raise ValueError(f"C of pair ({i}, {j}) has a row with more than one link.")
