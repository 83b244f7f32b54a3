"""`solver: fast`: Eq. 2 by a primal-dual scheme on the graph of pixels, from coarse to fine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stages.photometry.joint.problem_assembly import finest_level, problem_of
from stages.photometry.joint.pyramid import Level, pyramid
from stages.photometry.joint.stopping_rule import Round, verdict
from stages.photometry.paper.alternation import Outcome
from stages.photometry.paper.energy import EnergyTerms, EnergyWeights, channel_terms
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.free_memory import give_back_free_memory, keep_large_blocks_apart
from stages.solvers.kernels.threading_layer import use_threads
from stages.solvers.primal_dual.graph import PrimalDual
from stages.solvers.primal_dual.problem import Steps

PIXELS_PER_THREAD = 20_000
DARK = 0.01  # of the mean shading: the quotient of a darker pixel is no start
UNIFORM = 1 / np.sqrt(4 * np.pi)  # ν of the first harmonic, the same for every normal


@dataclass(frozen=True)
class FastSettings:
    """How the fast solver goes about it.

    Attributes
    ----------
    weights : EnergyWeights
    tolerance : float
        What may be left to gain, relative energy, for the finest level to be done.
    gap_tolerance : float
        How far the albedo may then be from its optimum under the light it has, relative energy.
    max_rounds : int
        Rounds of the finest level at most.
    round_iterations : int
        Iterations between two looks at the energy.
    coarse_iterations : int
        On the level above the finest; twice as many on every further one.
    steps : Steps
        Of an iteration, in units of the scaled image.
    fewest_pixels : int
        Per view at the coarsest level.
    """

    weights: EnergyWeights
    tolerance: float = 1e-3
    gap_tolerance: float = 0.03
    max_rounds: int = 100
    round_iterations: int = 80
    coarse_iterations: int = 120
    steps: Steps = Steps()
    fewest_pixels: int = 40


@dataclass(frozen=True, eq=False)
class FastDescent:
    """The solution.

    Attributes
    ----------
    albedo : ndarray, shape (N, 3), float32
    light : ndarray, shape (n, 3, K), float64
    shading : ndarray, shape (N, 3), float64
    terms : tuple of EnergyTerms
        Eq. 2's, per channel, in the gauge.
    rounds : tuple of Round
        The first is the state that they began with, the last the solution: an earlier one again where it
        did not converge and the energy has risen since.
    outcome : Outcome
    """

    albedo: np.ndarray
    light: np.ndarray
    shading: np.ndarray
    terms: tuple[EnergyTerms, ...]
    rounds: tuple[Round, ...]
    outcome: Outcome


def solve(
    views: StackedViews,
    images: list[np.ndarray],
    settings: FastSettings,
    threads: int,
    step: Callable[[], None],
) -> FastDescent:
    """Minimise Eq. 2 in all channels together, from coarse to fine: Eq. 9 and 10 in one iteration.

    Parameters
    ----------
    views : StackedViews
    images : list of 3 ndarray, shape (N,)
        Scaled.
    settings : FastSettings
    threads : int
        Never changes the result.
    step : callable
        Called after every round.
    """
    return finish(  # nothing on the way has a name: a level, a descent that is held takes room
        views,
        images,
        from_coarse_to_fine(finest_level(views, images, settings.weights), settings, threads),
        settings,
        step,
    )


def from_coarse_to_fine(
    finest: Level, settings: FastSettings, threads: int, light: np.ndarray | None = None
) -> PrimalDual:
    """Descend on every coarser level, the coarsest first; the finest one then begins where they end.

    A light that is given, (n, 3, K), stays as it is.
    """
    keep_large_blocks_apart()
    levels = pyramid(finest, settings.fewest_pixels)
    del finest  # a level makes room once it is arranged
    groups = [level.group for level in levels if level.group is not None]  # the finest has none
    use_threads(threads_for(levels[0].pixels, threads))
    descent = start(levels.pop(0), settings) if light is None else under(light, levels.pop(0), settings)
    while levels:
        descent.iterate(settings.coarse_iterations * 2 ** (len(levels) - 1))
        legacy = descent.legacy()
        del descent  # before the finer level takes its place
        use_threads(threads_for(levels[0].pixels, threads))
        problem = problem_of(levels.pop(0))
        give_back_free_memory()
        descent = PrimalDual.inheriting(legacy, problem, groups[0])
        del legacy  # makes room for what follows
        descent.fill_in(groups.pop(0))
        give_back_free_memory()
    return descent


def start(level: Level, settings: FastSettings) -> PrimalDual:
    """The paper's start: the image is all albedo, and the shading as near to 1 as the basis allows."""
    problem = problem_of(level)
    albedo = level.image / level.share[:, None]
    light = np.zeros((level.starts.size - 1, 3, level.basis.shape[1]))
    light[:, :, 0] = 1 / UNIFORM
    return PrimalDual(problem, problem.slices.spread(albedo), light, settings.steps)


def under(light: np.ndarray, level: Level, settings: FastSettings) -> PrimalDual:
    """Begin with the image divided by its shading, where there is any, and leave the light alone."""
    view = level.view_of_pixel
    shading = np.stack(
        [np.einsum("pk,pk->p", level.basis[:, :, c], light[view, c]) for c in range(3)], axis=1
    )
    lit = shading > DARK * max(float(shading.mean()), 1e-12)
    albedo = np.where(lit, level.image / np.where(lit, shading, 1), 0).astype(np.float32)
    problem = problem_of(level)
    return PrimalDual(problem, problem.slices.spread(albedo), light, settings.steps, free_light=False)


def threads_for(pixels: int, threads: int) -> int:
    """Threads that have enough to do between two barriers."""
    return min(threads, 1 + pixels // PIXELS_PER_THREAD)


def finish(
    views: StackedViews,
    images: list[np.ndarray],
    descent: PrimalDual,
    settings: FastSettings,
    step: Callable[[], None],
) -> FastDescent:
    """Go in rounds on the finest level until the energy settles.

    Where it does not, the best state seen is kept. A descent that the caller does not keep makes room for
    what is looked at in the end.
    """
    rounds = [_look(descent)]
    best, kept = rounds[0], (descent.albedo.copy(), descent.light)
    outcome = None
    for _ in range(settings.max_rounds):
        descent.iterate(settings.round_iterations)
        rounds.append(_look(descent))
        step()
        if sum(rounds[-1].energy) <= sum(best.energy):
            np.copyto(kept[0], descent.albedo)
            best, kept = rounds[-1], (kept[0], descent.light)
        outcome = verdict(rounds, settings.tolerance, settings.gap_tolerance)
        if outcome is not None:
            break
    if outcome is Outcome.CONVERGED:  # its gap is the one that was judged
        kept = descent.albedo, descent.light
    elif rounds[-1] is not best:
        rounds.append(best)
    albedo, light = descent.problem.slices.collect(kept[0]), kept[1]
    del descent, kept
    give_back_free_memory()
    shading = views.shadings(light)
    terms = channel_terms(views, images, albedo, shading)
    return FastDescent(albedo, light, shading, terms, tuple(rounds), outcome or Outcome.LIMIT_REACHED)


def _look(descent: PrimalDual) -> Round:
    bounds = descent.bounds()
    return Round(descent.iterations, tuple(bounds.energy.tolist()), bounds.gap)
