"""Compiled loops over the correspondences of a pair of views.

A pair is C_ij by compressed rows, `ends` and `columns`, and the numbers of the first pixels of its views.
"""

from __future__ import annotations

import numba

import stages.solvers.kernels.threading_layer  # noqa: F401


@numba.njit(cache=True, nogil=True)
def count_linked(ends, columns, here, there, trusted, count):
    """Count the correspondences between trusted pixels at both of them."""
    for row in range(len(ends) - 1):
        for place in range(ends[row], ends[row + 1]):
            p, q = here + row, there + columns[place]
            if trusted[p] and trusted[q]:
                count[p] += 1
                count[q] += 1


@numba.njit(cache=True, nogil=True)
def add_differences(ends, columns, here, there, trusted, values, total):
    """Add the differences of values, (N, C), from pixel to pixel, to the totals of both."""
    for row in range(len(ends) - 1):
        for place in range(ends[row], ends[row + 1]):
            p, q = here + row, there + columns[place]
            if trusted[p] and trusted[q]:
                for channel in range(values.shape[1]):
                    difference = values[p, channel] - values[q, channel]
                    total[p, channel] += difference
                    total[q, channel] -= difference


@numba.njit(cache=True, nogil=True)
def vote_dark(ends, columns, here, there, trusted, values, darker, balance):
    """Add 1 to a pixel whose value is darker than the other's by more than that, else subtract 1."""
    for row in range(len(ends) - 1):
        for place in range(ends[row], ends[row + 1]):
            p, q = here + row, there + columns[place]
            if trusted[p] and trusted[q]:
                difference = values[q] - values[p]
                balance[p] += 1 if difference > darker else -1
                balance[q] += 1 if -difference > darker else -1


@numba.njit(cache=True, nogil=True)
def lower_to_linked(ends, columns, here, there, trusted, values, least):
    """Lower what is least around each pixel to the values of its correspondences."""
    for row in range(len(ends) - 1):
        for place in range(ends[row], ends[row + 1]):
            p, q = here + row, there + columns[place]
            if trusted[p] and trusted[q]:
                least[p] = min(least[p], values[q])
                least[q] = min(least[q], values[p])
