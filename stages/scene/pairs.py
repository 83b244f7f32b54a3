"""Pairs of views, or of photos, by index."""

from __future__ import annotations

from itertools import combinations


def all_pairs(count: int) -> list[tuple[int, int]]:
    """List all pairs i < j of `count` views: what Eq. 5 sums over."""
    return list(combinations(range(count), 2))
