"""`solver: fast`: Eq. 2 by a primal-dual scheme on the graph of pixels, from coarse to fine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.process.free_memory import give_back_garbage, large_blocks_apart
from stages.photometry.joint.coarse_to_fine import from_coarse_to_fine
from stages.photometry.joint.problem_assembly import finest_level
from stages.photometry.joint.settings import FastSettings, Stopping
from stages.photometry.joint.stopping_rule import Round, verdict
from stages.photometry.paper.alternation import Outcome
from stages.photometry.paper.energy import EnergyTerms, EnergyWeights, channel_terms
from stages.photometry.stack import StackedViews
from stages.solvers.primal_dual.graph import PrimalDual


@dataclass(frozen=True)
class FastSolver:
    """Weights, stopping rule and settings of the fast solver.

    Attributes
    ----------
    weights : EnergyWeights
    stopping : Stopping
    how : FastSettings
        `stopping` is already resolved from it.
    """

    weights: EnergyWeights
    stopping: Stopping
    how: FastSettings = FastSettings()


@dataclass(frozen=True, eq=False)
class FastDescent:
    """Solution of the fast solver.

    Attributes
    ----------
    albedo : ndarray, shape (N, 3), float32
    light : ndarray, shape (n, 3, K), float64
    shading : ndarray, shape (N, 3), float64
    terms : tuple of EnergyTerms
        Of Eq. 2, per channel, in the gauge.
    rounds : tuple of Round
        The first is the initial state, the last the solution. Without convergence, where the energy has risen
        since, the round of the best state is repeated at the end.
    outcome : Outcome
    """

    albedo: np.ndarray
    light: np.ndarray
    shading: np.ndarray
    terms: tuple[EnergyTerms, ...]
    rounds: tuple[Round, ...]
    outcome: Outcome


@dataclass(frozen=True, eq=False)
class Settled:
    """Where the fast solver has come to; as of `FastDescent`, before its energy is evaluated term by term."""

    albedo: np.ndarray
    light: np.ndarray
    rounds: tuple[Round, ...]
    outcome: Outcome

    def evaluated(self, views: StackedViews, images: list[np.ndarray]) -> FastDescent:
        """Evaluate the sums of Eq. 2, of 3 images (N,), and the shading."""
        shading = views.shadings(self.light)
        terms = channel_terms(views, images, self.albedo, shading)
        return FastDescent(self.albedo, self.light, shading, terms, self.rounds, self.outcome)


@large_blocks_apart()
def solve(
    views: StackedViews,
    images: list[np.ndarray],
    solver: FastSolver,
    threads: int,
    step: Callable[[], None],
) -> FastDescent:
    """Minimise Eq. 2 in all channels together, from coarse to fine: Eq. 9 and 10 in one iteration.

    Parameters
    ----------
    views : StackedViews
    images : list of 3 ndarray, shape (N,)
        Scaled.
    solver : FastSolver
    threads : int
        Never changes the result.
    step : callable
        Called after every round.
    """
    settled = descend(  # intermediates have no name: a named level or descent would stay in memory
        from_coarse_to_fine(finest_level(views, images, solver.weights), solver.how, threads), solver, step
    )
    return settled.evaluated(views, images)


def descend(descent: PrimalDual, solver: FastSolver, step: Callable[[], None]) -> Settled:
    """Iterate in rounds on the finest level until the stopping rule holds.

    Without convergence, the best state is returned. If the caller holds no reference to the descent, its
    memory is freed at the end.
    """
    stopping, how = solver.stopping, solver.how
    round_iterations = how.schedule(known_light=not descent.free_light).round_iterations
    rounds = [_evaluated(descent, how)]
    best, kept = rounds[0], (descent.albedo.copy(), descent.light)
    outcome = None
    for _ in range(stopping.max_rounds):
        descent.iterate(round_iterations)
        rounds.append(_evaluated(descent, how))
        step()
        if sum(rounds[-1].energy) <= sum(best.energy):
            np.copyto(kept[0], descent.albedo)
            best, kept = rounds[-1], (kept[0], descent.light)
        outcome = verdict(rounds, stopping, how)
        if outcome is not None:
            break
    if outcome is Outcome.CONVERGED:  # the gap that met the stopping rule
        kept = descent.albedo, descent.light
    elif rounds[-1] is not best:
        rounds.append(best)
    albedo, light = descent.problem.slices.collect(kept[0]), kept[1]
    del descent, kept
    give_back_garbage()
    return Settled(albedo, light, tuple(rounds), outcome or Outcome.LIMIT_REACHED)


def _evaluated(descent: PrimalDual, how: FastSettings) -> Round:
    bounds = descent.bounds(how.gap_ranges)
    return Round(descent.iterations, tuple(bounds.energy.tolist()), bounds.gap)
