"""Stopping rule of `solver: fast`: the remaining decrease of the energy, extrapolated from the rounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.photometry.joint.settings import FastSettings, Stopping
from stages.photometry.paper.alternation import Outcome


@dataclass(frozen=True)
class Round:
    """State after a round.

    Attributes
    ----------
    iterations : int
        Total so far, on the finest level.
    energy : tuple of float
        Eq. 2 per channel, in the gauge; summed in float32 within every eight pixels.
    gap : float
        Upper bound of the excess over the least energy under this light, relative to the energy.
    """

    iterations: int
    energy: tuple[float, ...]
    gap: float


def verdict(rounds: Sequence[Round], stopping: Stopping, how: FastSettings) -> Outcome | None:
    """Decide the outcome of the descent; None while it is to continue.

    Parameters
    ----------
    rounds : sequence of Round
        The first is the initial state.
    stopping : Stopping
        The tolerance is compared with `left_to_gain`.
    how : FastSettings
        Least number of rounds, and criteria of a stall.
    """
    if len(rounds) <= how.min_rounds:
        return None
    left = left_to_gain(rounds)
    if left <= stopping.tolerance and rounds[-1].gap <= stopping.gap:
        return Outcome.CONVERGED
    stuck = rounds[-1].gap > how.stalled_gap * rounds[len(rounds) // 2].gap
    return Outcome.STALLED if left <= how.negligible_gain * stopping.tolerance and stuck else None


def left_to_gain(rounds: Sequence[Round]) -> float:
    """Extrapolate the remaining decrease, relative to the current energy; infinite without deceleration.

    Notes
    -----
    With b the decrease over the last doubling of the rounds, a that over the one before, and a constant ratio
    b/a, the remaining decrease is ``b²/(a − b)``. This is exact for an error that falls as a power of the
    number of rounds. A slow descent looks settled from one round to the next, but gains more with every
    doubling: a < b. A plateau as long as all rounds before it would be mistaken for convergence. Energies are
    replaced by their running minimum; where the last one exceeds it, at least the difference remains.
    """
    energies = np.array([sum(one.energy) for one in rounds])
    least, last = np.minimum.accumulate(energies), len(energies) - 1
    quarter, half, now = np.interp([last / 4, last / 2, last], np.arange(len(least)), least).tolist()
    before, lately = quarter - half, half - now
    if now <= 0:
        return 0.0
    risen = (energies[-1] - now) / now
    if lately <= 0:
        return risen
    return max(risen, lately**2 / (before - lately) / now) if before > lately else float("inf")
