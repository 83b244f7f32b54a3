"""How lists of photos are named in sentences."""

from __future__ import annotations

from collections.abc import Sequence


def listed(names: Sequence[str], at_most: int = 12) -> str:
    """``a, b, c``, and how many more there are beyond `at_most`.

    >>> listed(["a", "b", "c"], at_most=2)
    'a, b and 1 more'
    """
    more = len(names) - at_most
    return ", ".join(names[:at_most]) + (f" and {more} more" if more > 0 else "")
