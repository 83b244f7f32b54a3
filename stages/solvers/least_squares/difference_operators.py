"""D_x and D_y of Eq. 17: forward differences between neighbouring pixels of the same mask."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

Pixels = tuple[np.ndarray, np.ndarray]


def first_pixels(masks: Sequence[np.ndarray]) -> np.ndarray:
    """Count the pixels of all masks, as offsets of the views in the stacked vector of Eq. 17.

    Returns
    -------
    ndarray, shape (n + 1,), int64
        View i owns the numbers ``starts[i]:starts[i + 1]``, row by row.
    """
    counts = [int(np.count_nonzero(mask)) for mask in masks]
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def neighbours(mask: np.ndarray, first: int = 0) -> tuple[Pixels, Pixels]:
    """List the pairs of pixels of one mask that D_x and D_y subtract: right − left, below − above.

    Parameters
    ----------
    mask : ndarray, shape (h, w), bool
    first : int
        Number of its first pixel.

    Returns
    -------
    along_x, along_y : tuple of two ndarray, shape (·,), int32
        Numbers of the pixels on either side; x points right, y down.
    """
    number = np.cumsum(mask.ravel(), dtype=np.int32).reshape(mask.shape) + np.int32(first - 1)
    wide, tall = mask[:, :-1] & mask[:, 1:], mask[:-1] & mask[1:]
    return (number[:, :-1][wide], number[:, 1:][wide]), (number[:-1][tall], number[1:][tall])


def difference_matrices(masks: Sequence[np.ndarray]) -> tuple[sp.csr_array, sp.csr_array]:
    """Build D_x and D_y (Eq. 4, 17): ``(D_x ρ)(p) = ρ(p + (1, 0)) − ρ(p)`` where both are in Ω, 0 elsewhere.

    Parameters
    ----------
    masks : sequence of ndarray, shape (h_i, w_i), bool
        Ω of every view; N pixels together.

    Returns
    -------
    d_x, d_y : csr_array, shape (N, N), float64
        x points right, y down. The row of a pixel whose neighbour is not in Ω is empty: the border of a
        mask adds nothing.
    """
    starts = first_pixels(masks)
    pairs = [neighbours(mask, first) for mask, first in zip(masks, starts[:-1].tolist(), strict=True)]
    along_x, along_y = zip(*pairs, strict=True)
    return _differences(along_x, int(starts[-1])), _differences(along_y, int(starts[-1]))


def _differences(pairs: Sequence[Pixels], total: int) -> sp.csr_array:
    """Build rows p that hold −1 at p and +1 at its neighbour."""
    here, there = (np.concatenate(side) for side in zip(*pairs, strict=True))
    rows = np.concatenate([here, here])
    columns = np.concatenate([here, there])
    values = np.repeat([-1.0, 1.0], here.size)
    return sp.csr_array((values, (rows, columns)), shape=(total, total))
