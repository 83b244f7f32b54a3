"""D_x and D_y of Eq. 17: forward differences between neighbouring pixels of the same mask."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp


def pixel_numbers(masks: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Number the pixels of all masks, view after view, row by row: places in the stacked vector of Eq. 17.

    Parameters
    ----------
    masks : sequence of ndarray, shape (h_i, w_i), bool

    Returns
    -------
    list of ndarray, shape (h_i, w_i), int64
        −1 outside the mask.
    """
    numbers, start = [], 0
    for mask in masks:
        own = np.full(mask.shape, -1, np.int64)
        count = int(np.count_nonzero(mask))
        own[mask] = np.arange(start, start + count)
        numbers.append(own)
        start += count
    return numbers


def difference_matrices(masks: Sequence[np.ndarray]) -> tuple[sp.csr_array, sp.csr_array]:
    """Build D_x and D_y: ``(D_x ρ)(p) = ρ(p + (1, 0)) − ρ(p)`` where both pixels are in Ω, 0 elsewhere.

    Parameters
    ----------
    masks : sequence of ndarray, shape (h_i, w_i), bool
        Ω of every view; N pixels together.

    Returns
    -------
    d_x, d_y : csr_array, shape (N, N), float64
        x points right, y down. The row of a pixel whose neighbour is not in Ω is empty: nothing is charged
        at the border of a mask.
    """
    numbers = pixel_numbers(masks)
    total = sum(int(np.count_nonzero(mask)) for mask in masks)
    right = [(own[:, :-1], own[:, 1:]) for own in numbers]
    below = [(own[:-1], own[1:]) for own in numbers]
    return _differences(right, total), _differences(below, total)


def _differences(neighbours: list[tuple[np.ndarray, np.ndarray]], total: int) -> sp.csr_array:
    """Row p holds −1 at p and +1 at its neighbour, for the pairs that are both in Ω."""
    here = np.concatenate([first.ravel() for first, _ in neighbours])
    there = np.concatenate([second.ravel() for _, second in neighbours])
    both = (here >= 0) & (there >= 0)
    here, there = here[both], there[both]
    rows = np.concatenate([here, here])
    columns = np.concatenate([here, there])
    values = np.repeat([-1.0, 1.0], here.size)
    return sp.csr_array((values, (rows, columns)), shape=(total, total))
