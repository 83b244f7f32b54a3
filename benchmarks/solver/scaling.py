"""One thread against several."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.solver.kernel import KernelSpeed, kernel_speed
from benchmarks.solver.ours import endless, timed
from benchmarks.solver.problems import RaceProblem

ROUNDS = 3


@dataclass(frozen=True)
class ThreadedSpeed:
    """Speed with a number of threads on one problem.

    Attributes
    ----------
    problem : str
    kernel : KernelSpeed
    solve_s : float
        Time of graph, pyramid and `ROUNDS` rounds on the finest level.
    """

    problem: str
    kernel: KernelSpeed
    solve_s: float


def threaded_speeds(problem: RaceProblem, threads: int, seconds: float) -> tuple[ThreadedSpeed, ...]:
    """Measure with one thread and with all, each kernel for about so many seconds."""
    return tuple(
        ThreadedSpeed(
            problem.name,
            kernel_speed(problem, count, seconds),
            timed(problem, count, endless(problem, ROUNDS)).total_s,
        )
        for count in sorted({1, threads})
    )
