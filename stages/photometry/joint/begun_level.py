"""A coarse level of all views, solved: descents of some of their pixels begin from it, and end at it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.process.free_memory import give_back_free_memory
from stages.photometry.joint.joined_level import places_of
from stages.photometry.joint.pyramid import Level
from stages.solvers.kernels.pixelwise import EVERYWHERE, Chosen
from stages.solvers.kernels.simd import COUNT
from stages.solvers.primal_dual.graph import PrimalDual
from stages.solvers.primal_dual.half_edges import HalfEdges, half_edges_of
from stages.solvers.primal_dual.problem import Problem
from stages.solvers.primal_dual.prolongation import CoarseState


@dataclass(frozen=True, eq=False)
class BegunLevel:
    """A solved level, and where in it the views of a part of it are.

    Attributes
    ----------
    depth : int
        Levels between it and the finest, itself included.
    places : ndarray, shape (G,), int64
        Of its pixels; see `places_of`.
    state : CoarseState
        Of all views, under a known light.
    views : sequence of int
        Numbers, among all, of the views that begin from it.
    origins : ndarray, shape (n, 2), int64
        Row and column of the whole view where the crop of each begins: multiples of 2^depth.
    rim : ndarray, shape (N,), bool
        Pixels of these, on the finest level, beside which others are cut off.
    """

    depth: int
    places: np.ndarray
    state: CoarseState
    views: Sequence[int]
    origins: np.ndarray
    rim: np.ndarray

    def descent(self, problem: Problem, group: np.ndarray) -> PrimalDual:
        """Initialise the next finer level of these views; its `groups`, (N,)."""
        light = np.ones((len(self.views), *self.state.light.shape[1:]))
        here = replace(self.state, light=light, multiplier=np.zeros_like(problem.wanted))
        descent = PrimalDual.from_coarse(here, problem, group)
        give_back_free_memory()  # pages of the state
        descent.fill_in(group)
        return descent

    def pinned(self, finest: Level) -> Level:
        """Hold the rim of the finest level, which is overwritten, at the albedo of the solved one.

        The data term of its pixels becomes ``W |ρ − ρ_solved|``, W the sum of the weights of their edges: no
        albedo of the neighbours moves them.
        """
        held = np.flatnonzero(self.rim)
        at = self.state.slices.places[self.groups(finest, self.depth, held)]
        albedo = self.state.albedo[at // COUNT, :, at % COUNT]
        weight = _weights_at(held, finest.graph)[:, None]
        finest.basis[held], finest.image[held] = weight[:, None], weight * albedo
        return finest

    def groups(self, level: Level, depth: int = 1, some: Chosen = EVERYWHERE) -> np.ndarray:
        """Find the pixel of the solved level that each of one so many levels finer is in, int32."""
        places = places_of(level, self.views, self.origins >> self.depth, depth, some)
        return np.searchsorted(self.places, places).astype(np.int32)


def _weights_at(pixels: np.ndarray, graph: HalfEdges) -> np.ndarray:
    """Sum the weights of the edges of some pixels, (n,), float32."""
    of = np.repeat(np.arange(len(pixels)), graph.first[pixels + 1] - graph.first[pixels])
    weight = graph.weight[half_edges_of(graph.first, pixels)]
    return np.bincount(of, weight, len(pixels)).astype(np.float32)
