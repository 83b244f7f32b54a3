"""Dependence on the start: ``python -m benchmarks.solver.starts [--problems bust,fountain,plane-PIXELS]``.

Solves every problem from three starts and prints how far apart they end.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from itertools import combinations

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

import numpy as np  # noqa: E402

from benchmarks.solver.__main__ import THREADS, problems_named  # noqa: E402
from benchmarks.solver.problems import RaceProblem  # noqa: E402
from pipeline.command.terminal import Terminal  # noqa: E402
from stages.evaluation.scaled_error import least_squares_scale  # noqa: E402
from stages.photometry.joint.coarse_to_fine import start, steps_of, threads_for  # noqa: E402
from stages.photometry.joint.fast_alternation import (  # noqa: E402
    FastDescent,
    FastSolver,
    descend,
    solve,
)
from stages.photometry.joint.problem_assembly import finest_level  # noqa: E402
from stages.photometry.joint.settings import USUAL, FastSettings  # noqa: E402
from stages.solvers.kernels.threading_layer import use_threads  # noqa: E402
from stages.solvers.primal_dual.graph import PrimalDual  # noqa: E402

STARTS = ("coarse to fine", "ρ = I", "constant")


def main(argv: Sequence[str] | None = None) -> None:
    """Solve from every start, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--problems", default="bust,fountain")
    parser.add_argument("--threads", type=int, default=THREADS)
    given, terminal = parser.parse_args(argv), Terminal()
    sentences: list[str] = []
    print("| problem | λ, μ | start | outcome | iterations | energy above the least | gap |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for problem in problems_named(given.problems.split(","), False, terminal, sentences):
        found = {name: solve_from(name, problem, given.threads) for name in STARTS}
        for row in rows(problem, found):
            print(row, flush=True)
        print(
            f"{problem.name}: root mean square between two albedos after one scale: {apart(found)}",
            flush=True,
        )
    for sentence in sentences:
        terminal.say(sentence)


def solve_from(name: str, problem: RaceProblem, threads: int) -> FastDescent:
    """Solve by the default settings; only the first start uses coarser levels."""
    solver, views, images = FastSolver(problem.weights, USUAL["paper"]), problem.fresh_views(), problem.images
    if name == "coarse to fine":
        return solve(views, images, solver, threads, lambda: None)
    descent = start(finest_level(views, images, problem.weights), solver.how)
    if name == "constant":
        descent = constant(descent)
    use_threads(threads_for(problem.pixels, threads))
    return descend(descent, solver, lambda: None).evaluated(views, images)


def constant(descent: PrimalDual) -> PrimalDual:
    """Start the same problem from a constant albedo, the mean of the image."""
    problem = descent.problem
    albedo = np.broadcast_to(problem.image.mean(axis=(0, 2), keepdims=True), problem.image.shape).copy()
    return PrimalDual(problem, albedo, descent.light, steps_of(FastSettings(), known_light=False))


def rows(problem: RaceProblem, found: dict[str, FastDescent]) -> Iterator[str]:
    """Build a row of the table for every start."""
    energies = {name: energy(problem, descent) for name, descent in found.items()}
    least = min(energies.values())
    weights = f"{problem.weights.smoothness:g}, {problem.weights.consistency:g}"
    for name, descent in found.items():
        last = max(descent.rounds, key=lambda one: one.iterations)
        above = f"{100 * (energies[name] / least - 1):.3f} %"
        outcome = descent.outcome.name.lower().replace("_", " ")
        yield (
            f"| {problem.name} | {weights} | {name} | {outcome} | {last.iterations} | {above} | "
            f"{100 * descent.rounds[-1].gap:.1f} % |"
        )


def energy(problem: RaceProblem, descent: FastDescent) -> float:
    """Sum the energy of all channels, in the gauge."""
    return sum(terms.total(problem.weights) for terms in descent.terms)


def apart(found: dict[str, FastDescent]) -> str:
    """Compute the greatest distance over the channels for every pair of starts."""
    return "; ".join(
        f"{one} and {other} {max(distances(found[one].albedo, found[other].albedo)):.4f}"
        for one, other in combinations(found, 2)
    )


def distances(one: np.ndarray, other: np.ndarray) -> list[float]:
    """Compute the RMS difference per channel of two albedos (N, 3) after a single scale."""
    return [
        float(np.sqrt(np.mean((t - least_squares_scale(p, t) * p) ** 2)))
        for p, t in zip(other.T.astype(np.float64), one.T.astype(np.float64), strict=True)
    ]


if __name__ == "__main__":
    main()
