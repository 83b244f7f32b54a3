"""The view graph: which pairs of views are linked, few per view, so that cost is linear in views."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import minimum_spanning_tree

Pair = tuple[int, int]


def best_pairs(sharpness: sp.csr_array, view_of_point: np.ndarray, most: int) -> list[Pair]:
    """Choose pairs of views: for each view those that see its surface best, and a tree that connects all.

    Parameters
    ----------
    sharpness : csr_array, shape (p, n)
        How sharply view j shows surface point i, which one of the views shows; 0 where it does not.
    view_of_point : ndarray, shape (p,), int
        The view that each point was taken from.
    most : int
        Number of other views that each view chooses at most; others may choose it as well.

    Returns
    -------
    list of (int, int)
        Pairs i < j, sorted.

    Notes
    -----
    A view's points each have observers of relative sharpness q, 1 for the sharpest. Greedily that view is
    added that has the most of ``Σ q/(1 + c)``, c the sum of q over the observers of the point that are
    chosen already: points that few see count more than those that all see. A maximum spanning tree on the
    surface in common is added, so that parts of the graph do not drift apart.
    """
    relative = _over_sharpest(sharpness)
    chosen = set(_tree(relative, view_of_point))
    for view in range(relative.shape[1]):
        others = sp.csc_array(relative[view_of_point == view])
        chosen |= {(min(view, one), max(view, one)) for one in best_observers(others, view, most)}
    return sorted(chosen)


def _over_sharpest(sharpness: sp.csr_array) -> sp.csr_array:
    """Divide each row by its greatest value."""
    greatest = sharpness.max(axis=1).toarray().ravel()
    return sp.csr_array(sp.diags_array(1 / np.where(greatest > 0, greatest, 1)) @ sharpness)


def best_observers(others: sp.csc_array, view: int, most: int) -> list[int]:
    """Choose the views, at most so many, that together see a view's points best; `others`: (k points, n)."""
    seen, chosen = np.zeros(others.shape[0]), []
    left = np.ones(others.shape[1], bool)
    left[view] = False
    for _ in range(most):
        gain = np.where(left, others.T @ (1 / (1 + seen)), 0)
        best = int(np.argmax(gain))
        if gain[best] <= 0:
            break
        chosen.append(best)
        left[best] = False
        seen += others[:, [best]].toarray().ravel()
    return chosen


def _tree(relative: sp.csr_array, view_of_point: np.ndarray) -> list[Pair]:
    """Span the views that have surface in common by a tree of most surface."""
    count = relative.shape[1]
    points = np.arange(len(view_of_point))
    owners = sp.csr_array((np.ones(len(points)), (view_of_point, points)), shape=(count, len(points)))
    common = owners @ relative
    common = sp.csr_array(common + common.T)
    common.data = 1 / common.data
    one, other = minimum_spanning_tree(common).nonzero()  # views themselves are no edges of a tree
    return [(min(pair), max(pair)) for pair in zip(one.tolist(), other.tolist(), strict=True)]
