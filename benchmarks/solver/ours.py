"""`solver: fast` in the race, unchanged except for its stopping rule."""

from __future__ import annotations

import time
from dataclasses import dataclass

from benchmarks.solver.clock import Look, Trace
from benchmarks.solver.problems import RaceProblem
from stages.photometry.joint.fast_alternation import FastDescent, FastSolver, solve
from stages.photometry.joint.settings import USUAL, Stopping

NAME = "ours"
NEVER = -1.0  # a tolerance that nothing meets


@dataclass(frozen=True, eq=False)
class TimedDescent:
    """Result of `solve`, and the end of each round; evaluations of the energy are included in the times.

    Attributes
    ----------
    descent : FastDescent
    seconds : tuple of float
        End of each round, including graph and pyramid.
    total_s : float
        Time of its return.
    """

    descent: FastDescent
    seconds: tuple[float, ...]
    total_s: float

    @property
    def iterations(self) -> int:
        """Iterations on the finest level."""
        return max(one.iterations for one in self.descent.rounds)

    @property
    def round_s(self) -> float:
        """Mean seconds of a round after the first; 0 if there was no other."""
        return (self.seconds[-1] - self.seconds[0]) / max(len(self.seconds) - 1, 1)

    @property
    def start_s(self) -> float:
        """Start of the first round: after graph, coarser levels and the first evaluation of the energy."""
        return max(self.seconds[0] - self.round_s, 0.0)

    def trace(self) -> Trace:
        """Sum the energies of all channels, against time."""
        seconds = (self.start_s, *self.seconds)
        rounds = self.descent.rounds[: len(seconds)]  # a further one repeats the best
        energies = [sum(one.energy) for one in rounds]
        return Trace(NAME, tuple(Look(s, e) for s, e in zip(seconds, energies, strict=True)))


def race(problem: RaceProblem, budget_s: float, threads: int, most_rounds: int) -> Trace:
    """Run as many rounds as the time allows, estimated from a trial of two rounds."""
    rehearsal = timed(problem, threads, endless(problem, 2))
    rounds = int((budget_s - rehearsal.start_s) / rehearsal.round_s)
    return timed(problem, threads, endless(problem, min(max(rounds, 2), most_rounds))).trace()


def endless(problem: RaceProblem, rounds: int) -> FastSolver:
    """Build default settings that stop only by the number of rounds."""
    return FastSolver(problem.weights, Stopping(NEVER, USUAL["paper"].gap, rounds))


def timed(problem: RaceProblem, threads: int, solver: FastSolver) -> TimedDescent:
    """Solve and measure the time."""
    seconds: list[float] = []
    began = time.perf_counter()

    def note() -> None:
        seconds.append(time.perf_counter() - began)

    descent = solve(problem.views, problem.images, solver, threads, note)
    return TimedDescent(descent, tuple(seconds), time.perf_counter() - began)
