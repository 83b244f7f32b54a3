"""What `PrimalDual` is to solve, and how far its iterations go."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.solvers.kernels.sliced_ellpack import Slices
from stages.solvers.primal_dual.sliced_graph import SlicedGraph


@dataclass(frozen=True)
class Steps:
    """How far an iteration goes.

    Attributes
    ----------
    scale : float
        r, in units of the albedo: how far the albedo goes, and how little the duals.
    data_step_ratio : float
        κ: how much faster the data's duals move than the edges', and how much slower the light.
    relaxation : float
        θ of plain iterations, 1 (none) to below 2: each goes θ times as far as the scheme without it.
    reflection : float
        How many times as far an iteration goes that is then drawn back, 1 (no further) to 2.
    epoch : int
        Iterations of one kind, before as many of the other: plain, or gone twice as far and drawn back to
        where the epoch began. Between them the gauge is restored, and it is looked at how strongly the pixels
        see the light.
    rank_tolerance : float
        Directions of the light that the pixels see less than this, relative to the one that they see most,
        stay as they are.
    """

    scale: float
    data_step_ratio: float
    relaxation: float
    reflection: float
    epoch: int
    rank_tolerance: float


@dataclass(frozen=True, eq=False)
class Problem:
    """``min Σ_p |I_p − ρ_p σ·ν_p| + Σ_{pq} w_pq |ρ_p − ρ_q|`` in every channel, in the gauge.

    Attributes
    ----------
    slices : Slices
    graph : SlicedGraph
    image : ndarray, shape (S, 3, 8), float32
        I.
    basis : ndarray, shape (S, K, 1 or 3, 8), float32
        ν, shared by the channels or of each.
    share : ndarray, shape (S, 1, 8), float32
        What a pixel counts in the gauge: 1, or a group's fullness; 0 where no pixel is.
    gauge_of_view : ndarray, shape (n,), int64
        Views that no link joins have each a scale of their own, and a gauge each: which one.
    wanted : ndarray, shape (G, 3), float64
        What ``Σ share |ρ|`` is to be in every gauge.
    """

    slices: Slices
    graph: SlicedGraph
    image: np.ndarray
    basis: np.ndarray
    share: np.ndarray
    gauge_of_view: np.ndarray
    wanted: np.ndarray

    def by_gauge(self, of_views: np.ndarray) -> np.ndarray:
        """Add values of every view, (n, …), up for every gauge, (G, …)."""
        sums = np.zeros((len(self.wanted), *of_views.shape[1:]))
        np.add.at(sums, self.gauge_of_view, of_views)
        return sums
