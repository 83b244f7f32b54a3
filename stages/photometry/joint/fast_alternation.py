"""`solver: fast`: Eq. 2 by a primal-dual scheme on the graph of pixels, from coarse to fine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.process.free_memory import give_back_free_memory, give_back_garbage, large_blocks_apart
from stages.photometry.joint.problem_assembly import finest_level, problem_of
from stages.photometry.joint.pyramid import Level, pyramid
from stages.photometry.joint.settings import FastSettings, Stopping
from stages.photometry.joint.stopping_rule import Round, verdict
from stages.photometry.paper.alternation import Outcome
from stages.photometry.paper.energy import EnergyTerms, EnergyWeights, channel_terms
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.threading_layer import use_threads
from stages.solvers.primal_dual.graph import PrimalDual
from stages.solvers.primal_dual.problem import Steps

PIXELS_PER_THREAD = 20_000  # with fewer, barriers cost more than threads gain; changes speed, no result
UNIFORM = 1 / np.sqrt(4 * np.pi)  # ν of the first harmonic, the same for every normal


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


def from_coarse_to_fine(
    finest: Level,
    how: FastSettings,
    threads: int,
    light: np.ndarray | None = None,
    folder: Path | None = None,
) -> PrimalDual:
    """Descend on every coarser level, coarsest first; returns the finest, initialised from them.

    A given light, (n, 3, K), is held fixed. In a folder, if there is one, the state of a level waits until
    the next is arranged.
    """
    levels = pyramid(finest, how.coarsest_pixels)
    del finest  # frees each level once it is arranged
    give_back_free_memory()
    groups = [level.group for level in levels if level.group is not None]  # the finest has none
    schedule = how.schedule(known_light=light is not None)
    use_threads(threads_for(levels[0].pixels, threads))
    descent = start(levels.pop(0), how) if light is None else under(light, levels.pop(0), how)
    while levels:
        share = how.coarse_iterations * 2 ** (len(levels) - 1) // len(schedule.coarse_scales)
        for scale in schedule.coarse_scales:
            descent.set_scale(how.steps.scale * scale)
            descent.iterate(share)
        coarse = descent.coarse_state().in_file(folder)
        del descent  # before the finer level takes its place
        use_threads(threads_for(levels[0].pixels, threads))
        give_back_free_memory()
        problem = problem_of(levels.pop(0))
        give_back_free_memory()
        descent = PrimalDual.from_coarse(coarse, problem, groups[0])
        del coarse  # frees memory for the next step
        descent.fill_in(groups.pop(0))
        give_back_free_memory()
    descent.set_scale(how.steps.scale)
    return descent


def start(level: Level, how: FastSettings) -> PrimalDual:
    """Initialise as the paper does: albedo equal to the image, shading as near to 1 as the basis allows."""
    problem = problem_of(level)
    albedo = level.image / level.share[:, None]
    light = np.zeros((level.starts.size - 1, 3, level.basis.shape[1]))
    light[:, :, 0] = 1 / UNIFORM
    return PrimalDual(problem, problem.slices.spread(albedo), light, steps_of(how, known_light=False))


def under(light: np.ndarray, level: Level, how: FastSettings) -> PrimalDual:
    """Initialise with ρ = I/S where S is large enough, else 0; the light is held fixed."""
    view = level.view_of_pixel
    shading = np.stack(
        [np.einsum("pk,pk->p", level.basis[:, :, c], light[view, c]) for c in range(3)], axis=1
    )
    lit = shading > how.start_shading * max(float(shading.mean()), 1e-12)
    albedo = np.where(lit, level.image / np.where(lit, shading, 1), 0).astype(np.float32)
    problem = problem_of(level)
    steps = steps_of(how, known_light=True)
    return PrimalDual(problem, problem.slices.spread(albedo), light, steps, free_light=False)


def threads_for(pixels: int, threads: int) -> int:
    """Limit the threads to those with enough pixels between two barriers."""
    return min(threads, 1 + pixels // PIXELS_PER_THREAD)


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


def steps_of(how: FastSettings, known_light: bool) -> Steps:
    """Convert the settings of an iteration to the solver's."""
    steps = how.steps
    return Steps(
        scale=steps.scale,
        data_step_ratio=steps.data_step_ratio,
        relaxation=steps.relaxation,
        reflection=steps.reflection,
        epoch=how.schedule(known_light).epoch,
        rank_tolerance=steps.rank_tolerance,
    )


def _evaluated(descent: PrimalDual, how: FastSettings) -> Round:
    bounds = descent.bounds(how.gap_ranges)
    return Round(descent.iterations, tuple(bounds.energy.tolist()), bounds.gap)
