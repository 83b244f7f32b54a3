"""Division of a sum into parts, each of which a thread sums up by itself, in its order.

As many parts on any number of threads leave the same result on each; their number changes rounding only.
"""

from __future__ import annotations

import numba


@numba.njit(inline="always")
def part_of(number, parts, count):
    """Compute where one of `parts` equal parts of `count` values begins and ends."""
    return number * count // parts, (number + 1) * count // parts
