"""`mode: paper`: the alternation of light and albedo, channel by channel, with history and outcome."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass
from enum import Enum

import numpy as np

from stages.photometry.paper.albedo_step import albedo_step
from stages.photometry.paper.energy import (
    EnergyTerms,
    EnergyWeights,
    energy_terms,
    gauge_scale,
    smoothed_energy,
)
from stages.photometry.paper.light_step import light_step
from stages.photometry.paper.settings import PaperSettings
from stages.photometry.stack import StackedViews


class Outcome(Enum):
    """Outcome of an alternation; the text suggests what to try."""

    CONVERGED = "converged: the energy hardly changes any more"
    LIMIT_REACHED = (
        "limit reached: the energy was still changing; allow more alternations (paper.max_alternations; "
        "solver: fast: fast.max_rounds), or accept a larger relative change of the energy "
        "(paper.energy_tolerance; fast.tolerance)"
    )
    STALLED = (
        "stalled: the energy hardly changed, but the albedo was not shown to be near its optimum under the "
        "light it has, so that this may be the solver's standstill and not the model's; allow more "
        "conjugate-gradient steps (solver: paper), or accept a wider gap (solver: fast)"
    )


def worse(one: Outcome, other: Outcome) -> Outcome:
    """Choose the outcome that did not converge, if there is one."""
    return other if one is Outcome.CONVERGED else one


@dataclass(frozen=True, eq=False)
class State:
    """ρ^(k), shape (N,), and σ^(k), shape (n, 9), in the gauge; the terms of their energy."""

    albedo: np.ndarray
    light: np.ndarray
    terms: EnergyTerms


@dataclass(frozen=True)
class AlternationRecord:
    """Record of one alternation.

    Attributes
    ----------
    smoothed_before, smoothed_after_light, smoothed_after_albedo : float
        δ-smoothed energy before each half-step and after the last, all before the gauge is reapplied: it
        never rises.
    gauge_scale : float
        Factor by which ρ was then brought back into the gauge.
    energy : float
        Eq. 2 in the gauge, at the end.
    terms : EnergyTerms
        Its sums, not weighted.
    relative_change : float
        |energy − energy before| / energy before.
    cg_steps, cg_relative_residual, cg_reached
        Of the albedo step.
    """

    smoothed_before: float
    smoothed_after_light: float
    smoothed_after_albedo: float
    gauge_scale: float
    energy: float
    terms: EnergyTerms
    relative_change: float
    cg_steps: int
    cg_relative_residual: float
    cg_reached: bool


@dataclass(frozen=True, eq=False)
class Descent:
    """Descent of one channel: current state, history, and the outcome once it has ended."""

    state: State
    start_energy: float
    history: tuple[AlternationRecord, ...] = ()
    outcome: Outcome | None = None

    @property
    def ended(self) -> Outcome:
        """Outcome of a descent that has ended.

        Raises
        ------
        ValueError
            It has not ended.
        """
        if self.outcome is None:
            raise ValueError(f"not over after {len(self.history)} alternations")
        return self.outcome


def start(views: StackedViews, image: np.ndarray, weights: EnergyWeights) -> Descent:
    """Initialise with the paper's guess: ρ = I, which is in the gauge, and σ = 1."""
    light = np.ones((views.view_count, views.basis.shape[1]))
    terms = energy_terms(views, image, image, light)
    return Descent(State(image.copy(), light, terms), terms.total(weights))


def alternate(
    views: StackedViews, image: np.ndarray, state: State, weights: EnergyWeights, how: PaperSettings
) -> tuple[State, AlternationRecord]:
    """Perform one alternation, (k) → (k + 1).

    Eq. 9: ``{σ^i}^(k+1) = argmin_σ ε({σ^i, ρ^i,(k)})``, by one reweighting (Eq. 11).

    Eq. 10: ``{ρ^i}^(k+1) = argmin_ρ ε({σ^i,(k+1), ρ^i})``, by one reweighting (Eq. 13).

    Then the gauge is reapplied to ρ (Deviation 1), and inversely to σ.
    """
    before = smoothed_energy(views, image, state.albedo, state.light, weights, how.delta)
    light = light_step(views, image, state.albedo, state.light, how)
    after_light = smoothed_energy(views, image, state.albedo, light, weights, how.delta)
    solved = albedo_step(views, image, state.albedo, light, weights, how)
    after_albedo = smoothed_energy(views, image, solved.x, light, weights, how.delta)
    scale = gauge_scale(image, solved.x)
    albedo, light = solved.x * scale, light / scale
    terms = energy_terms(views, image, albedo, light)
    record = AlternationRecord(
        smoothed_before=before,
        smoothed_after_light=after_light,
        smoothed_after_albedo=after_albedo,
        gauge_scale=scale,
        energy=terms.total(weights),
        terms=terms,
        relative_change=_relative_change(state.terms.total(weights), terms.total(weights)),
        cg_steps=solved.steps,
        cg_relative_residual=solved.relative_residual,
        cg_reached=solved.reached,
    )
    return State(albedo, light, terms), record


def advance(
    views: StackedViews, image: np.ndarray, descent: Descent, weights: EnergyWeights, how: PaperSettings
) -> Descent:
    """Perform one alternation, and set the outcome if the energy has settled or the limit is reached."""
    state, record = alternate(views, image, descent.state, weights, how)
    history = (*descent.history, record)
    outcome = None
    if record.relative_change <= how.energy_tolerance:
        outcome = Outcome.CONVERGED if record.cg_reached else Outcome.STALLED
    elif len(history) >= how.max_alternations:
        outcome = Outcome.LIMIT_REACHED
    return Descent(state, descent.start_energy, history, outcome)


def decompose_channels(
    views: StackedViews,
    images: Sequence[np.ndarray],
    weights: EnergyWeights,
    how: PaperSettings,
    executor: Executor,
    after_each: Callable[[], None] = lambda: None,
) -> list[Descent]:
    """Alternate the light (Eq. 9) and the albedo (Eq. 10) in every channel, from the paper's initial guess.

    Parameters
    ----------
    views : StackedViews
    images : sequence of ndarray, shape (N,), float64
        The channels of the linear images, scaled to a 99th percentile of 1, in which `how.delta` is stated.
    weights : EnergyWeights
    how : PaperSettings
    executor : Executor
        Runs the channels concurrently. Each task is one alternation of one channel, so that no worker waits
        for the slowest channel; the result does not depend on the timing of the tasks.
    after_each : callable
        Called in this thread after every alternation.

    Returns
    -------
    list of Descent
        One per channel, each with its outcome: converged, or why it stopped.
    """
    descents = [start(views, image, weights) for image in images]
    _ = views.equations  # computed once here, else every channel's thread would compute it

    def submit(channel: int) -> Future[Descent]:
        return executor.submit(advance, views, images[channel], descents[channel], weights, how)

    pending = {submit(channel): channel for channel in range(len(images))}
    while pending:
        for future in wait(pending, return_when=FIRST_COMPLETED).done:
            channel = pending.pop(future)
            descents[channel] = future.result()
            after_each()
            if descents[channel].outcome is None:
                pending[submit(channel)] = channel
    return descents


def _relative_change(before: float, after: float) -> float:
    """Compute |after − before| / before; 0 if equal, so that a black channel converges at once."""
    return 0.0 if after == before else abs(after - before) / max(before, 1e-300)
