"""Real photographs with measured reflectance: ``python -m benchmarks.mit_berkeley [--quick]``.

Ten lamps are ten views of one viewpoint. For `mode: paper`'s core every pixel corresponds to itself in all
45 pairs, and normals come from the given orthographic depth. Rule for its λ and μ: the pair of a stated grid
with the least LMSE on the first object, kept for the others. Cartoon-texture has in addition its best λ per
object, the mean of its ten cartoons, and a solver that nearly converges. `mode: transfer` has its
defaults; its input is that of a user, photos, cameras far away and the depth as a mesh, in a workspace
per object.

LMSE (windows of 20 px, step 10, at the reduced size) and si-RMSE with one scale for all estimates of an
object, on gray linear values as in the data set's own program. Needs
``$UNSHADE_DATA/gt-mit-berkeley-intrinsic``.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import asdict, dataclass
from itertools import product
from multiprocessing import get_context
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

from benchmarks.mit_berkeley.methods import (  # noqa: E402
    Problem,
    Row,
    best_of,
    by_transfer,
    cartoon_lines,
    cartoons,
    images_themselves,
    paper_sweep,
)
from benchmarks.mit_berkeley.objects import LAMPS, objects_folder, read_object  # noqa: E402
from pipeline import UserError  # noqa: E402
from pipeline.command.terminal import Terminal  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
OBJECTS = ("box", "dinosaur", "panther")  # the first is the one that λ and μ are chosen on


@dataclass(frozen=True)
class Plan:
    """Sizes, grids and limits of a call."""

    reduction: int
    fidelities: tuple[float, ...]
    lambdas: tuple[float, ...]
    mus: tuple[float, ...]
    far: int
    far_tolerance: float


FIDELITIES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0)
FULL = Plan(3, FIDELITIES, (0.1, 0.2, 0.5, 1, 2, 5), (0.2, 1, 5), 300, 1e-6)
QUICK = Plan(6, FIDELITIES[1::2], (0.2, 0.5, 1, 2), (1,), 150, 1e-5)


def experiment(
    folder: Path, plan: Plan, workspace: Path, threads: Executor, processes: Executor, cores: int
) -> dict[str, list[Row]]:
    """Compute table and sweeps: threads for compiled code, processes for scipy, which uses one core."""
    terminal = Terminal()
    problems = [Problem.of(read_object(folder / name, plan.reduction)) for name in OBJECTS]
    for problem in problems:
        pixels = int(problem.subject.mask.sum())
        terminal.say(
            f"{problem.subject.name}: {pixels} pixels × {LAMPS} lamps, 1/{plan.reduction} of the size"
        )
    places = [workspace / f"{problem.subject.name}-{plan.reduction}" for problem in problems]
    ours = [by_transfer(problem, to, cores, terminal) for problem, to in zip(problems, places, strict=True)]
    cartoon_rows = [cartoons(problem, plan.fidelities, threads) for problem in problems]
    kept = best_of(row for row in cartoon_rows[0] if row.method == "cartoon-texture").notes["lambda_"]
    sweep = paper_sweep(problems[0], list(product(plan.lambdas, plan.mus)), processes)
    chosen = best_of(sweep).notes
    pair = chosen["lambda_"], chosen["mu"]
    terminal.say(
        f"least LMSE on {OBJECTS[0]}: λ = {pair[0]:g}, μ = {pair[1]:g}; cartoon-texture λ = {kept:g}"
    )
    near = [processes.submit(p.decompose, *pair) for p in problems]
    far = [processes.submit(p.decompose, *pair, plan.far, plan.far_tolerance) for p in problems]
    table = []
    for problem, own, stopped, on, last in zip(problems, cartoon_rows, near, far, ours, strict=True):
        table += images_themselves(problem)
        table += cartoon_lines(own, kept)
        table.append(problem.score_descent("mode: paper", stopped.result(), *pair))
        table.append(problem.score_descent("the same energy, iterated on", on.result(), *pair))
        table.append(last)
    return {"cartoons": sum(cartoon_rows, []), "sweep": sweep, "table": table}


def as_text(rows: Sequence[Row]) -> str:
    """Format the rows under a heading, with notes."""
    lines = [f"{'object':<10}{'method':<36}{'LMSE':>8}{'si-RMSE':>9}  notes"]
    for row in rows:
        notes = ", ".join(f"{key.rstrip('_')} {_short(value)}" for key, value in row.notes.items())
        lines.append(f"{row.subject:<10}{row.method:<36}{row.lmse:>8.4f}{row.si_rmse:>9.4f}  {notes}")
    return "\n".join(lines)


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def main(arguments: Sequence[str]) -> int:
    """Print the sweeps and the table; 2 where there is no data."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mit_berkeley", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="smaller images and grids")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all rows there too")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "mit-berkeley")
    given = parser.parse_args(arguments)
    plan = QUICK if given.quick else FULL
    began = time.monotonic()
    try:
        folder = objects_folder()
        with (
            ThreadPoolExecutor(given.threads) as threads,
            ProcessPoolExecutor(given.threads, mp_context=get_context("spawn")) as processes,
        ):
            found = experiment(folder, plan, given.workspace, threads, processes, given.threads)
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    for title, rows in found.items():
        print(f"\n{title}\n{as_text(rows)}")
    print(f"\n{time.monotonic() - began:.0f} s on {given.threads} threads")
    if given.json:
        content = {title: [asdict(row) for row in rows] for title, rows in found.items()}
        given.json.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
