"""`solver: fast`: Eq. 2 by a primal-dual scheme on the graph of pixels, from coarse to fine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stages.photometry.alternation import Outcome
from stages.photometry.energy import EnergyTerms, EnergyWeights, channel_terms
from stages.photometry.pyramid import Level, pyramid
from stages.photometry.saddle import finest_level, problem_of
from stages.photometry.stack import StackedViews
from stages.solvers.primal_dual_graph import PrimalDual, Steps
from stages.solvers.threading_layer import use_threads

PIXELS_PER_THREAD = 20_000
UNIFORM = 1 / np.sqrt(4 * np.pi)  # ν of the first harmonic, the same for every normal
STANDSTILL = 5  # rounds without progress, the gap still open, after which more would be waste


@dataclass(frozen=True)
class FastSettings:
    """How the fast solver goes about it.

    Attributes
    ----------
    weights : EnergyWeights
    tolerance : float
        Relative fall of the energy over a round at which the finest level is done.
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
    tolerance: float = 1e-4
    gap_tolerance: float = 0.02
    max_rounds: int = 100
    round_iterations: int = 60
    coarse_iterations: int = 120
    steps: Steps = Steps()
    fewest_pixels: int = 40


@dataclass(frozen=True)
class Round:
    """What a round left.

    Attributes
    ----------
    iterations : int
        So far, on the finest level.
    energy : tuple of float
        Eq. 2 per channel, in the gauge; summed in float32 within every eight pixels.
    gap : float
        How far the energy may at most be above that of the best albedo under this light, relative to it.
    """

    iterations: int
    energy: tuple[float, ...]
    gap: float


@dataclass(frozen=True, eq=False)
class FastDescent:
    """The solution.

    Attributes
    ----------
    albedo : ndarray, shape (N, 3), float32
    light : ndarray, shape (n, 3, K), float64
    terms : tuple of EnergyTerms
        Eq. 2's, per channel, in the gauge.
    rounds : tuple of Round
        The first is the state that the coarser levels left, the last the solution: an earlier one again
        where the energy has risen since.
    outcome : Outcome
    """

    albedo: np.ndarray
    light: np.ndarray
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
    """Minimise Eq. 2 in all channels together, from coarse to fine.

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
    levels = pyramid(finest_level(views, images, settings.weights), settings.fewest_pixels)
    group = levels[0].group
    descent = start(levels.pop(0), settings)
    while levels:
        use_threads(threads_for(descent.problem.slices.pixels, threads))
        descent.iterate(settings.coarse_iterations * 2 ** (len(levels) - 1))
        finer_group = levels[0].group
        descent = PrimalDual.refined(descent, problem_of(levels.pop(0)), group)
        group = finer_group
    use_threads(threads_for(descent.problem.slices.pixels, threads))
    return _finish(views, images, descent, settings, step)


def start(level: Level, settings: FastSettings) -> PrimalDual:
    """The paper's start: the image is all albedo, and the shading as near to 1 as the basis allows."""
    problem = problem_of(level)
    albedo = level.image / level.share[:, None]
    light = np.zeros((level.starts.size - 1, 3, level.basis.shape[1]))
    light[:, :, 0] = 1 / UNIFORM
    return PrimalDual(problem, problem.slices.spread(albedo), light, settings.steps)


def threads_for(pixels: int, threads: int) -> int:
    """Threads that have enough to do between two barriers."""
    return min(threads, 1 + pixels // PIXELS_PER_THREAD)


def _finish(
    views: StackedViews,
    images: list[np.ndarray],
    descent: PrimalDual,
    settings: FastSettings,
    step: Callable[[], None],
) -> FastDescent:
    """Rounds on the finest level until the energy settles; the best state seen is kept."""
    rounds = [_look(descent, 0)]
    best, kept = rounds[0], (descent.albedo.copy(), descent.light)
    outcome, standing = Outcome.LIMIT_REACHED, 0
    for k in range(1, settings.max_rounds + 1):
        descent.iterate(settings.round_iterations)
        rounds.append(_look(descent, k * settings.round_iterations))
        least, energy = sum(best.energy), sum(rounds[-1].energy)
        step()
        if energy <= least:
            np.copyto(kept[0], descent.albedo)
            best, kept = rounds[-1], (kept[0], descent.light)
        standing = standing + 1 if abs(least - energy) <= settings.tolerance * least else 0
        if standing and rounds[-1].gap <= settings.gap_tolerance:
            outcome = Outcome.CONVERGED
            break
        if standing == STANDSTILL:
            outcome = Outcome.STALLED
            break
    if rounds[-1] is not best:
        rounds.append(best)
    albedo, light = descent.problem.slices.collect(kept[0]), kept[1]
    return FastDescent(albedo, light, channel_terms(views, images, albedo, light), tuple(rounds), outcome)


def _look(descent: PrimalDual, iterations: int) -> Round:
    bounds = descent.bounds()
    return Round(iterations, tuple(bounds.energy.tolist()), bounds.gap)
