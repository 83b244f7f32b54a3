"""Problem and step sizes of `PrimalDual`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.solvers.kernels.sliced_ellpack import Slices
from stages.solvers.primal_dual.sliced_graph import SlicedGraph


@dataclass(frozen=True)
class Steps:
    """Step sizes of an iteration.

    Attributes
    ----------
    scale : float
        r, in units of the albedo: steps of the albedo grow with it, those of the duals shrink.
    data_step_ratio : float
        κ: steps of the data's duals over those of the edges'; steps of the light are divided by it.
    relaxation : float
        θ of plain iterations, 1 (none) to below 2: factor of the step.
    reflection : float
        Factor of the step of Halpern iterations, 1 (none) to 2.
    epoch : int
        Iterations of one kind, before as many of the other: plain, or reflected Halpern iterations. Between
        them the gauge is restored, and the normal equations of the light are recomputed.
    rank_tolerance : float
        Directions of the light whose eigenvalue in these is below this fraction of the greatest are not
        updated.
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
        ν, shared by the channels or one per channel.
    share : ndarray, shape (S, 1, 8), float32
        Weight of a pixel in the gauge: 1, or the filled share of a group; 0 where no pixel is.
    gauge_of_view : ndarray, shape (n,), int64
        Index of the gauge of every view; views without common correspondences have separate scales.
    wanted : ndarray, shape (G, 3), float64
        Value of ``Σ share |ρ|`` that every gauge fixes.
    """

    slices: Slices
    graph: SlicedGraph
    image: np.ndarray
    basis: np.ndarray
    share: np.ndarray
    gauge_of_view: np.ndarray
    wanted: np.ndarray

    def by_gauge(self, of_views: np.ndarray) -> np.ndarray:
        """Sum values of every view, (n, …), per gauge, (G, …)."""
        sums = np.zeros((len(self.wanted), *of_views.shape[1:]))
        np.add.at(sums, self.gauge_of_view, of_views)
        return sums
