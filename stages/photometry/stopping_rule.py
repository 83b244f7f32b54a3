"""When `solver: fast` is done: what the rounds so far say about what further ones would bring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stages.photometry.alternation import Outcome

FEWEST = 4  # rounds before anything is concluded
WASTE = 0.25  # of the tolerance: where less than that is gained, an open gap is not going to close soon


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


def verdict(rounds: Sequence[Round], tolerance: float, gap_tolerance: float) -> Outcome | None:
    """Say how the descent has ended, or None: it goes on.

    Parameters
    ----------
    rounds : sequence of Round
        The first is the state before any iteration on the finest level.
    tolerance : float
        Relative energy that the alternation may still gain; see `gained`.
    gap_tolerance : float
        How far the albedo may then be from its optimum under the light it has, relative energy.
    """
    if len(rounds) <= FEWEST:
        return None
    gain = gained(rounds)
    if gain <= tolerance and rounds[-1].gap <= gap_tolerance:
        return Outcome.CONVERGED
    return Outcome.STALLED if gain <= WASTE * tolerance else None


def gained(rounds: Sequence[Round]) -> float:
    """What the second half of all iterations has gained, relative to the energy now.

    Notes
    -----
    The error of a primal-dual descent falls at least as fast as one over the number of iterations. What it
    has gained since half their number is then at least what is still to be gained, however slow it is: a
    descent that crawls looks settled from one round to the next, but not from half of its way on.
    """
    energies = [sum(one.energy) for one in rounds]
    least, before = min(energies), min(energies[: (len(rounds) + 1) // 2])
    return (before - least) / least if least > 0 else 0.0
