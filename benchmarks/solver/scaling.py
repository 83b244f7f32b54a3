"""One thread against several."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.solver.kernel import KernelSpeed, kernel_speed
from benchmarks.solver.ours import endless, timed
from benchmarks.solver.problems import RaceProblem

ROUNDS = 3


@dataclass(frozen=True)
class ThreadedSpeed:
    """With some threads, on one problem.

    Attributes
    ----------
    problem : str
    kernel : KernelSpeed
    solve_s : float
        Graph, pyramid and `ROUNDS` rounds on the finest level.
    """

    problem: str
    kernel: KernelSpeed
    solve_s: float


def threaded_speeds(problem: RaceProblem, threads: int, seconds: float) -> tuple[ThreadedSpeed, ...]:
    """With one thread and with as many as there are, each kernel timed for about so many seconds."""
    return tuple(
        ThreadedSpeed(
            problem.name,
            kernel_speed(problem, count, seconds),
            timed(problem, count, endless(problem, ROUNDS)).total_s,
        )
        for count in sorted({1, threads})
    )
