"""`solver: fast`: Eq. 2 by a primal-dual scheme on the graph of pixels, the light refitted all along."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stages.photometry.alternation import Outcome
from stages.photometry.energy import EnergyTerms, EnergyWeights, energy_terms
from stages.photometry.light_refit import ViewBlocks, refit_light, shading_of
from stages.photometry.pyramid import Level, pyramid
from stages.photometry.stack import StackedViews
from stages.solvers.half_edges import half_edges
from stages.solvers.primal_dual_graph import PrimalDual
from stages.solvers.threading_layer import use_threads

PIXELS_PER_THREAD = 20_000


@dataclass(frozen=True)
class FastSettings:
    """How the fast solver goes about it.

    Attributes
    ----------
    weights : EnergyWeights
    tolerance : float
        Relative fall of the energy over a round at which the finest level is done.
    max_rounds : int
        Rounds of the finest level at most.
    refits_per_round, iterations_per_refit : int
        Light refits between two looks at the energy, and albedo iterations (even) between two refits.
    coarse_refits : int
        Refits on each coarser level.
    step_scale : float
        `scale` of `PrimalDual`, in units of the scaled image.
    fewest_pixels : int
        Per view at the coarsest level.
    """

    weights: EnergyWeights
    tolerance: float = 1e-4
    max_rounds: int = 100
    refits_per_round: int = 10
    iterations_per_refit: int = 6
    coarse_refits: int = 100
    step_scale: float = 0.03
    fewest_pixels: int = 500


@dataclass(frozen=True)
class Round:
    """What a round left: refits so far, and Eq. 2's terms per channel, in the gauge."""

    refits: int
    terms: tuple[EnergyTerms, ...]


@dataclass(frozen=True, eq=False)
class FastDescent:
    """The solution.

    Attributes
    ----------
    albedo : ndarray, shape (N, 3), float64
    light : ndarray, shape (n, 3, K), float64
    rounds : tuple of Round
        The first is the state that the coarser levels left, the last the solution: an earlier one again
        where the energy has risen since.
    outcome : Outcome
    """

    albedo: np.ndarray
    light: np.ndarray
    rounds: tuple[Round, ...]
    outcome: Outcome


class _Descent:
    """Albedo and light of one level on their way down."""

    def __init__(self, level: Level, albedo: np.ndarray, light: np.ndarray, settings: FastSettings):
        self.level, self.settings, self.light = level, settings, light
        self._solver = PrimalDual(level.graph, albedo, settings.step_scale)
        self._blocks = ViewBlocks(level.starts)
        self._wanted = np.abs(level.image).sum(axis=0, dtype=np.float64)

    @property
    def albedo(self) -> np.ndarray:
        return self._solver.albedo

    def refit(self, times: int) -> None:
        """Iterate on the albedo, refit the light, restore the gauge; `times` times."""
        level = self.level
        for _ in range(times):
            shading = shading_of(self._blocks, level.basis, self.light)
            self._solver.iterate(level.image, shading, self.settings.iterations_per_refit)
            self.light = refit_light(
                self._blocks, level.basis, level.image, self.albedo, self.light, self.settings.weights.delta
            )
            self._restore_gauge()

    def _restore_gauge(self) -> None:
        current = np.einsum("pc,p->c", np.abs(self.albedo), self.level.share, dtype=np.float64)
        factors = np.where((current > 0) & (self._wanted > 0), self._wanted / np.maximum(current, 1e-30), 1.0)
        self._solver.rescale(factors)
        self.light = self.light / factors[:, None]


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
    images : list of 3 ndarray, shape (N,), float64
        Scaled.
    settings : FastSettings
    threads : int
        Never changes the result.
    step : callable
        Called after every round.
    """
    levels = pyramid(_finest(views, images, settings.weights), settings.fewest_pixels)
    albedo = levels[0].image / levels[0].share[:, None]
    light = np.ones((views.view_count, 3, views.basis.shape[1]))
    for level in levels[:-1]:
        use_threads(_threads_for(level, threads))
        descent = _Descent(level, albedo, light, settings)
        descent.refit(settings.coarse_refits)
        albedo, light = descent.albedo[level.group], descent.light
    use_threads(_threads_for(levels[-1], threads))
    return _finish(views, images, _Descent(levels[-1], albedo, light, settings), step)


def _threads_for(level: Level, threads: int) -> int:
    """Threads that have enough to do between two barriers."""
    return min(threads, 1 + level.image.shape[0] // PIXELS_PER_THREAD)


def _finish(
    views: StackedViews, images: list[np.ndarray], descent: _Descent, step: Callable[[], None]
) -> FastDescent:
    """Rounds on the finest level until the energy settles; the best state seen is kept."""
    settings = descent.settings
    descent.refit(1)
    rounds = [_look(views, images, descent, 1)]
    best, kept = rounds[0], (descent.albedo.copy(), descent.light)
    outcome = Outcome.LIMIT_REACHED
    for k in range(1, settings.max_rounds + 1):
        descent.refit(settings.refits_per_round)
        rounds.append(_look(views, images, descent, 1 + k * settings.refits_per_round))
        least, energy = (_total(one, settings.weights) for one in (best, rounds[-1]))
        step()
        fall = (least - energy) / least if least > 0 else 0.0
        if energy <= least:
            best, kept = rounds[-1], (descent.albedo.copy(), descent.light)
        if abs(fall) <= settings.tolerance:
            outcome = Outcome.CONVERGED
            break
    if rounds[-1] is not best:
        rounds.append(best)
    return FastDescent(kept[0].astype(np.float64), kept[1], tuple(rounds), outcome)


def _finest(views: StackedViews, images: list[np.ndarray], weights: EnergyWeights) -> Level:
    operators = [(views.d_x, weights.smoothness), (views.d_y, weights.smoothness)]
    return Level(
        starts=views.starts,
        positions=views.positions,
        basis=views.basis.astype(np.float32),
        image=np.stack(images, axis=1).astype(np.float32),
        share=np.ones(len(images[0]), np.float32),
        graph=half_edges([*operators, (views.c, weights.consistency)]),
    )


def _look(views: StackedViews, images: list[np.ndarray], descent: _Descent, refits: int) -> Round:
    albedo = descent.albedo.astype(np.float64)
    return Round(
        refits,
        tuple(
            energy_terms(
                views, image, np.ascontiguousarray(albedo[:, c]), np.ascontiguousarray(descent.light[:, c])
            )
            for c, image in enumerate(images)
        ),
    )


def _total(one: Round, weights: EnergyWeights) -> float:
    return sum(terms.total(weights) for terms in one.terms)
