"""The paper's alternation (Eq. 9 to 17) with any solver inside, until the time is up."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass

import numpy as np

from benchmarks.solver.clock import Clock, Look, OutOfTime, Trace
from benchmarks.solver.inner_solvers import InnerSolver
from benchmarks.solver.problems import RaceProblem
from stages.photometry.paper.albedo_step import albedo_system
from stages.photometry.paper.energy import EnergyWeights, energy_terms, gauge_scale
from stages.photometry.paper.light_step import light_step
from stages.photometry.paper.settings import PaperSettings
from stages.photometry.stack import StackedViews

PAPER = PaperSettings()  # δ


@dataclass(frozen=True, eq=False)
class ChannelState:
    """ρ (N,) and σ (n, 9) of a channel, in the gauge; their time, and their energy."""

    albedo: np.ndarray
    light: np.ndarray
    look: Look


def race(problem: RaceProblem, inner: InnerSolver, budget_s: float, threads: int) -> Trace:
    """Alternate in all channels, concurrently, as the stage does.

    The paper's stopping rule is replaced by the time limit. Evaluations of the energy are not timed.
    """
    workers = min(threads, 3)
    clock = Clock(budget_s, workers)
    views = problem.fresh_views()
    _ = views.equations  # counts: no other method needs it
    images = [image.astype(np.float64) for image in problem.images]
    states = [_start(views, image, problem.weights, clock) for image in images]
    looks = [(state.look, channel) for channel, state in enumerate(states)]

    def advance(channel: int) -> ChannelState:
        return _alternate(views, images[channel], states[channel], problem.weights, inner, clock)

    with ThreadPoolExecutor(workers) as executor:
        for channel, state in _finished(advance, len(states), executor):
            states[channel] = state
            looks.append((state.look, channel))
    return Trace(inner.name, _together(looks, len(states)))


def _together(looks: list[tuple[Look, int]], channels: int) -> tuple[Look, ...]:
    """Combine the energies of single channels into their sum, from the first time that all are known.

    Concurrent channels may report in another order than they finished.
    """
    energies, sums = [0.0] * channels, []
    for heard, (look, channel) in enumerate(sorted(looks, key=lambda one: one[0].seconds), start=1):
        energies[channel] = look.energy
        if heard >= channels:
            sums.append(Look(look.seconds, sum(energies)))
    return tuple(sums)


def _finished(advance: Callable[[int], ChannelState], channels: int, executor: ThreadPoolExecutor):
    """Yield channels with their states as they finish, restarting each until the time is up."""
    pending: dict[Future[ChannelState], int] = {executor.submit(advance, c): c for c in range(channels)}
    while pending:
        done = wait(pending, return_when=FIRST_COMPLETED).done
        for future in done:
            channel = pending.pop(future)
            if isinstance(future.exception(), OutOfTime):
                continue
            yield channel, future.result()
            pending[executor.submit(advance, channel)] = channel


def _start(views: StackedViews, image: np.ndarray, weights: EnergyWeights, clock: Clock) -> ChannelState:
    """Compute the paper's initial guess."""
    light = np.ones((views.view_count, views.basis.shape[1]))
    return _looked_at(views, image, image, light, weights, clock)


def _alternate(
    views: StackedViews,
    image: np.ndarray,
    state: ChannelState,
    weights: EnergyWeights,
    inner: InnerSolver,
    clock: Clock,
) -> ChannelState:
    clock.check()
    light = light_step(views, image, state.albedo, state.light, PAPER)
    matrix, rhs = albedo_system(views, image, state.albedo, light, weights, PAPER.delta)
    albedo = inner.solve(matrix, rhs, state.albedo, clock.check)
    scale = gauge_scale(image, albedo)
    return _looked_at(views, image, albedo * scale, light / scale, weights, clock)


def _looked_at(
    views: StackedViews,
    image: np.ndarray,
    albedo: np.ndarray,
    light: np.ndarray,
    weights: EnergyWeights,
    clock: Clock,
) -> ChannelState:
    seconds = clock.seconds
    with clock.held():
        energy = energy_terms(views, image, albedo, light).total(weights)
    return ChannelState(albedo, light, Look(seconds, energy))
