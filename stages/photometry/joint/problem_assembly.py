"""Eq. 2 of stacked views as input of the fast solver: levels, and the saddle-point problem of each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from stages.photometry.joint.pyramid import Level
from stages.photometry.paper.energy import EnergyWeights
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.arrays_in_files import in_file
from stages.solvers.primal_dual.half_edges import HalfEdges, from_edges
from stages.solvers.primal_dual.problem import Problem
from stages.solvers.primal_dual.sliced_graph import sliced_graph, slices_of


@dataclass(frozen=True, eq=False)
class EdgeWeights:
    """λ and μ per edge; None: the constants of the energy.

    Attributes
    ----------
    smoothness : ndarray, shape (E,), or None
        λ, in the order of `StackedViews.neighbours`.
    agreement : ndarray, shape (L,), or None
        μ, in the order of `StackedViews.linked_pixels`.
    """

    smoothness: np.ndarray | None = None
    agreement: np.ndarray | None = None

    def in_file(self, folder: Path | None) -> EdgeWeights:
        """Move both, if they are there, to a file in a folder; see `arrays_in_files`."""
        if self.smoothness is None or self.agreement is None:
            return self
        return EdgeWeights(*in_file([self.smoothness, self.agreement], folder))


ALIKE = EdgeWeights()


def finest_level(
    views: StackedViews,
    images: list[np.ndarray],
    weights: EnergyWeights,
    edges: EdgeWeights = ALIKE,
    own: np.ndarray | None = None,
) -> Level:
    """Build the level of single pixels; images are 3 scaled channels of (N,).

    Where only some pixels are `own`, (N,), bool, the level is what they contribute: others count for
    nothing, and edges where the first of their pixels does.
    """
    return Level(
        starts=views.starts,
        positions=views.positions(),
        basis=views.basis.reshape(*views.basis.shape[:2], -1),
        image=np.stack(images, axis=1).astype(np.float32),
        share=np.ones(len(images[0]), np.float32) if own is None else own.astype(np.float32),
        graph=graph_of(views, weights, edges, own),
        gauge_of_view=_linked_views(views),
    )


def graph_of(
    views: StackedViews, weights: EnergyWeights, edges: EdgeWeights = ALIKE, own: np.ndarray | None = None
) -> HalfEdges:
    """Write λ times Eq. 4 plus μ times Eq. 5 as a graph of the pixels; `own`: see `finest_level`."""
    tail, head, touching = _ends(views)
    counts = touching, tail.size - touching
    weight = np.repeat(np.array([weights.smoothness, weights.consistency], np.float32), counts)
    if edges.smoothness is not None:
        weight[:touching] = edges.smoothness
    if edges.agreement is not None:
        weight[touching:] = edges.agreement
    if own is not None:
        weight *= own[tail]
    return from_edges(int(views.starts[-1]), tail, head, weight)


def _ends(views: StackedViews) -> tuple[np.ndarray, np.ndarray, int]:
    """List both pixels of every edge, (E,) each, neighbours first, and count these."""
    touching, linked = list(views.neighbours()), list(views.linked_pixels())
    tails, heads = zip(*touching, *linked, strict=True)
    return np.concatenate(tails), np.concatenate(heads), sum(p.size for p, _ in touching)


def _linked_views(views: StackedViews) -> np.ndarray:
    """Label the connected components of views, shape (n,): each component has its own scale."""
    pairs = np.array([pair for pair, block in views.correspondences.items() if block.nnz], np.int64).reshape(
        -1, 2
    )
    joined = sp.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=2 * (views.view_count,))
    return connected_components(joined, directed=False)[1].astype(np.int64)


def problem_of(level: Level) -> Problem:
    """Arrange a level in slices.

    If the caller holds no reference to the level, its graph is freed before the rest is arranged.
    """
    slices = slices_of(level.graph, level.starts)
    graph = sliced_graph(level.graph, slices)
    starts, gauge_of_view = level.starts, level.gauge_of_view
    image, basis, share = level.image, level.basis, level.share
    del level
    return Problem(
        slices=slices,
        graph=graph,
        image=slices.spread(image),
        basis=slices.spread_basis(basis),
        share=slices.spread(share[:, None]),
        gauge_of_view=gauge_of_view,
        wanted=_brightness(starts, image, gauge_of_view),
    )


def _brightness(starts: np.ndarray, image: np.ndarray, gauge_of_view: np.ndarray) -> np.ndarray:
    """Sum up |I| of every gauge and channel, (G, 3)."""
    gauge = np.repeat(gauge_of_view, np.diff(starts))
    count = int(gauge_of_view.max(initial=-1)) + 1
    return np.stack([np.bincount(gauge, np.abs(image[:, c]), count) for c in range(3)], axis=1)
