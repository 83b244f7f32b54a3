"""The exact optimum of an albedo step on graphs of any size: minimum cuts, one per halving of the levels.

PyMaxflow, the solver of the cuts, is under the GPL: so it may serve the tests, and nothing that is installed.
"""

from __future__ import annotations

import maxflow
import numpy as np

from stages.solvers.primal_dual.half_edges import HalfEdges


def best_by_cuts(
    graph: HalfEdges, image: np.ndarray, shading: np.ndarray, levels: np.ndarray | None = None
) -> np.ndarray:
    """The ρ of least Σ|I − S ρ| + Σ w |ρ_p − ρ_q| among those that take their values from the levels, (N,).

    Parameters
    ----------
    graph : HalfEdges
    image, shading : ndarray, shape (N,), float64
        I and S of one channel; S of either sign, or 0.
    levels : ndarray, shape (L,), float64, optional
        Ascending. Without them all I/S, among whose combinations is an optimum over all ρ.

    Notes
    -----
    A sum over thresholds θ between neighbouring levels of binary problems in ``x_p = [ρ_p > θ]``: a pixel
    pays the slope of its data term there, an edge ``w |x_p − x_q|``. The slopes grow with θ, so the solutions
    nest: a pixel above θ need not be asked below it. Each cut halves what is open in all intervals together,
    so that ⌈log₂ L⌉ of them do (Darbon and Sigelle 2006).
    """
    fits = np.divide(image, shading, out=np.zeros_like(image), where=shading != 0)
    if levels is None:
        levels = np.unique(fits[shading != 0]) if np.any(shading) else np.zeros(1)
    low, high = np.zeros(graph.size, np.int64), np.full(graph.size, levels.size - 1)
    while np.any(low < high):
        open_, middle = low < high, (low + high + 1) // 2
        slopes = np.abs(shading) * _slopes(fits, levels[np.maximum(middle - 1, 0)], levels[middle])
        above = open_ & _above(graph, np.where(open_, slopes, 0), low)
        low, high = np.where(above, middle, low), np.where(open_ & ~above, middle - 1, high)
    return levels[low]


def _slopes(fits: np.ndarray, below: np.ndarray, above: np.ndarray) -> np.ndarray:
    """(|above − fit| − |below − fit|) / (above − below), without the cancellation."""
    apart = np.where(above > below, above - below, 1)
    return np.clip((above + below - 2 * fits) / apart, -1, 1)


def _above(graph: HalfEdges, slopes: np.ndarray, interval: np.ndarray) -> np.ndarray:
    """Solve every interval's binary problem; a neighbour in a higher one is above, in a lower one below."""
    owner, neighbour = (
        np.repeat(np.arange(graph.size), np.diff(graph.first)),
        graph.neighbour.astype(np.int64),
    )
    weight, side = graph.weight.astype(np.float64), np.sign(interval[neighbour] - interval[owner])
    price = slopes - np.bincount(owner, side * weight, minlength=graph.size)
    inside = (side == 0) & (owner < neighbour)
    cut = maxflow.GraphFloat(graph.size, int(inside.sum()))
    nodes = cut.add_nodes(graph.size)
    cut.add_edges(owner[inside], neighbour[inside], weight[inside], weight[inside])
    cut.add_grid_tedges(nodes, np.maximum(price, 0), np.maximum(-price, 0))
    cut.maxflow()
    return cut.get_grid_segments(nodes)
