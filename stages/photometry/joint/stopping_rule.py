"""When `solver: fast` is done: what the rounds so far say about what further ones would bring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.photometry.joint.settings import FastSettings, Stopping
from stages.photometry.paper.alternation import Outcome


@dataclass(frozen=True)
class Round:
    """What a round left.

    Attributes
    ----------
    iterations : int
        So far, on the finest level, all of them.
    energy : tuple of float
        Eq. 2 per channel, in the gauge; summed in float32 within every eight pixels.
    gap : float
        How far the energy may at most be above that of the best albedo under this light, relative to it.
    """

    iterations: int
    energy: tuple[float, ...]
    gap: float


def verdict(rounds: Sequence[Round], stopping: Stopping, how: FastSettings) -> Outcome | None:
    """Say how the descent has ended, or None: it goes on.

    Parameters
    ----------
    rounds : sequence of Round
        The first is the state that they began with.
    stopping : Stopping
        The tolerance is compared with `left_to_gain`.
    how : FastSettings
        From how many rounds on, and what counts as a standstill.
    """
    if len(rounds) <= how.min_rounds:
        return None
    left = left_to_gain(rounds)
    if left <= stopping.tolerance and rounds[-1].gap <= stopping.gap:
        return Outcome.CONVERGED
    stuck = rounds[-1].gap > how.stalled_gap * rounds[len(rounds) // 2].gap
    return Outcome.STALLED if left <= how.negligible_gain * stopping.tolerance and stuck else None


def left_to_gain(rounds: Sequence[Round]) -> float:
    """Estimate what is left to gain, relative to the energy now; infinite where nothing slows down.

    Notes
    -----
    From what the last doubling of all rounds has gained, b, and the one before, a: were it to go on like
    that, every doubling gaining b/a of the one before, ``b²/(a − b)`` would be left. That is the whole of an
    error that falls as any power of their number. A descent that crawls looks settled from one round to the
    next, but gains more with every doubling: a < b. It is an estimate: a plateau as long as all
    rounds before it would pass for the end. Energies count by the least so far; where the last one
    is above that, at least the difference is left.
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
