"""Seconds and peak memory of our solver: ``python -m benchmarks.solver.growth PIXELS THREADS ROUNDS``.

Each size runs in its own process, since the peak memory of a process never falls.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent
CHANNELS = 3
CLOSE = 1.01  # of the least energy of the own run


@dataclass(frozen=True)
class Grown:
    """One size.

    Attributes
    ----------
    pixels : int
    seconds : float
        Time until the solver stops, by its own rule if the rounds suffice.
    close_s : float
        Time until its energy is within 1 % of the final one.
    iterations : int
        On the finest level.
    outcome : str
    peak_bytes : int
        Growth of the process's peak resident memory since before the problem was built: data that all solvers
        share (normals' basis, differences, correspondences, images) and memory of ours.
    given_bytes : int
        Part of it that the problem takes.
    """

    pixels: int
    seconds: float
    close_s: float
    iterations: int
    outcome: str
    peak_bytes: int
    given_bytes: int

    @property
    def peak_per_value(self) -> float:
        """Bytes per pixel and channel."""
        return self.peak_bytes / self.pixels / CHANNELS


def grow(sizes: Sequence[int], threads: int, most_rounds: int) -> tuple[Grown, ...]:
    """Measure every size, with this limit of rounds."""
    return tuple(_elsewhere(size, threads, most_rounds) for size in sizes)


def slope(sizes: Sequence[float], values: Sequence[float]) -> float:
    """Fit the slope of log values on log sizes, at least two: 1 for linear growth."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def _elsewhere(*numbers: int) -> Grown:
    command = [sys.executable, "-m", "benchmarks.solver.growth", *map(str, numbers)]
    answer = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return Grown(**json.loads(answer))


def measure(pixels: int, threads: int, most_rounds: int) -> Grown:
    """Measure one size, in this process."""
    from benchmarks.solver.corrugated_plane import corrugated_plane
    from benchmarks.solver.ours import endless, timed
    from pipeline.process.free_memory import give_back_free_memory
    from pipeline.process.meter import peak_bytes
    from stages.photometry.joint.fast_alternation import FastSolver
    from stages.photometry.joint.settings import USUAL

    tiny = corrugated_plane(2000)
    timed(tiny, threads, endless(tiny, 2))  # compiled code and libraries are loaded
    before = peak_bytes()
    problem = corrugated_plane(pixels)
    give_back_free_memory()  # what making the problem took is not the solver's
    given = peak_bytes() - before
    stopping = replace(USUAL["paper"], max_rounds=most_rounds)
    solved = timed(problem, threads, FastSolver(problem.weights, stopping))
    trace = solved.trace()
    return Grown(
        pixels=problem.pixels,
        seconds=solved.total_s,
        close_s=trace.seconds_to(CLOSE * trace.least),
        iterations=solved.iterations,
        outcome=solved.descent.outcome.name.lower(),
        peak_bytes=peak_bytes() - before,
        given_bytes=given,
    )


if __name__ == "__main__":
    print(json.dumps(asdict(measure(*map(int, sys.argv[1:])))))
