"""Energy against time: ``python -m benchmarks.solver [--quick | --full] [--to FOLDER]``.

Every method gets the same time on fountain-P11 (as finely as its workspace holds it), on the bust
(rendered if need be) and on growing graphs. `--quick` takes a small synthetic plane instead and takes less
than a minute; `--full` takes the bust at the paper's size and ten million pixels: hours.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

THREADS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order
os.environ.setdefault("OMP_NUM_THREADS", "1")  # of apxchol, whose channels go side by side, as all do

from benchmarks.solver.corrugated_plane import corrugated_plane  # noqa: E402
from benchmarks.solver.growth import grow  # noqa: E402
from benchmarks.solver.problems import RaceProblem  # noqa: E402
from benchmarks.solver.racing import Rules, hold, left_out, rival_names, warm_up  # noqa: E402
from benchmarks.solver.report import Findings, text_of, write_report  # noqa: E402
from benchmarks.solver.scaling import threaded_speeds  # noqa: E402
from pipeline import UserError  # noqa: E402
from pipeline.command.terminal import Terminal  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent
PROBLEMS = ("fountain", "bust")


@dataclass(frozen=True)
class Plan:
    """Problems, sizes and budgets of a call.

    Attributes
    ----------
    problems : tuple of str
        Names among `PROBLEMS`, or ``plane-PIXELS``.
    full : bool
        The bust at the paper's size.
    sizes : tuple of int
        Pixels of the growing graphs.
    most_rounds : int
        Limit of our rounds on these.
    kernel_s : float
        Time for which each inner loop is run.
    rules : Rules
    to : Path
    """

    problems: tuple[str, ...]
    full: bool
    sizes: tuple[int, ...]
    most_rounds: int
    kernel_s: float
    rules: Rules
    to: Path


def main(argv: Sequence[str] | None = None) -> Path:
    """Race, measure, print and write; returns the page.

    The page is written after every race, so that an interrupted call keeps its results.
    """
    plan, terminal = plan_of(arguments(argv)), Terminal()
    sentences = left_out()
    warm_up(plan.rules.threads)
    races, speeds = [], []
    for problem in problems_named(plan.problems, plan.full, terminal, sentences):
        races.append(hold(problem, plan.rules, terminal.say))
        if problem.views not in [race.problem.views for race in races[:-1]]:
            speeds += threaded_speeds(problem, plan.rules.threads, plan.kernel_s)
        write_report(plan.to, Findings(plan.rules, tuple(races), tuple(speeds), (), tuple(sentences)))
    grown = grow(plan.sizes, plan.rules.threads, plan.most_rounds)
    found = Findings(plan.rules, tuple(races), tuple(speeds), grown, tuple(sentences))
    page = write_report(plan.to, found)
    print(text_of(found))
    terminal.say(f"Read {page}")
    return page


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--quick", action="store_true", help="a small made-up plane: a minute")
    parser.add_argument("--full", action="store_true", help="the paper's size, ten million pixels: hours")
    parser.add_argument("--problems", help=f"comma-separated, of {', '.join(PROBLEMS)} and plane-PIXELS")
    parser.add_argument("--sizes", help="pixels of the growing graphs, comma-separated; empty for none")
    parser.add_argument("--budget", type=float, metavar="SECONDS", help="of every method on every problem")
    most = Rules.most_rounds
    parser.add_argument("--rounds", type=int, default=most, help="of ours at most, however short they are")
    parser.add_argument(
        "--rivals", type=_rivals, default=(), help="only those with one of these words in their names"
    )
    parser.add_argument("--threads", type=int, default=THREADS)
    parser.add_argument("--to", type=Path, default=ROOT / "workspaces" / "solver-benchmark")
    return parser.parse_args(argv)


def _rivals(words: str) -> tuple[str, ...]:
    given, names = tuple(word for word in words.split(",") if word), rival_names()
    for word in given:
        if not any(word in name for name in names):
            raise argparse.ArgumentTypeError(f"{word!r}: expected words in the names of {'; '.join(names)}.")
    return given


def plan_of(given: argparse.Namespace) -> Plan:
    """Plan problems, sizes and budgets of a call."""
    if given.quick:
        problems, budget_s, kernel_s = ("plane-10000",), 2.0, 0.3
        sizes, most_rounds = (10_000, 30_000, 100_000), 4
    else:
        problems, budget_s, kernel_s = PROBLEMS, 120.0, 6.0
        sizes, most_rounds = (100_000, 300_000, 1_000_000, 3_000_000), 100
    if given.full:
        sizes, budget_s = (*sizes, 10_000_000), 1800.0
    if given.problems:
        problems = tuple(given.problems.split(","))
    if given.sizes is not None:
        sizes = tuple(int(size) for size in given.sizes.split(",") if size)
    rules = Rules(given.budget or budget_s, given.threads, given.rounds, given.rivals)
    return Plan(problems, given.full, sizes, most_rounds, kernel_s, rules, given.to)


def problems_named(
    names: Sequence[str], full: bool, terminal: Terminal, sentences: list[str]
) -> Iterator[RaceProblem]:
    """Open problems one after the other; unavailable ones add a sentence."""
    for name in names:
        try:
            yield from _opened(name, full, terminal)
        except UserError as error:
            sentences.append(f"{name} is left out: {error}")


def _opened(name: str, full: bool, terminal: Terminal) -> Iterator[RaceProblem]:
    from benchmarks.solver.stored_problems import bust, fountain

    if name.startswith("plane-"):
        yield corrugated_plane(int(name.removeprefix("plane-")))
    elif name == "fountain":
        yield from fountain()
    elif name == "bust":
        yield from bust(full, terminal)
    else:
        raise UserError(f"it is no problem that is known; expected {', '.join(PROBLEMS)} or plane-PIXELS.")


if __name__ == "__main__":
    main()
