"""The paper's experiments, each a row: ``python -m benchmarks.paper [--quick | --tiny] [--to FOLDER]``.

Renders the rows, chooses λ and μ on Fig. 3, decomposes, evaluates, and writes ``paper.md`` with its pictures.
`--quick` stays at a quarter of the size and chooses λ and μ at a tenth; `--tiny` only tests that everything
runs. All renders and decompositions are kept in ``workspaces/paper…``, so that a second call reuses them.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

from benchmarks.paper.judging import Judge  # noqa: E402
from benchmarks.paper.laboratory import FULL, QUARTER, TENTH, TINY, Laboratory, Size  # noqa: E402
from benchmarks.paper.methods import Estimate, cartoon, image_itself, paper  # noqa: E402
from benchmarks.paper.pictures import figure  # noqa: E402
from benchmarks.paper.report import Experiment, Sweeps, write_report  # noqa: E402
from benchmarks.paper.rows import ROWS, Row  # noqa: E402
from benchmarks.paper.sweep import best, sweep_cartoon, sweep_paper  # noqa: E402
from benchmarks.paper.tables import Judged  # noqa: E402
from pipeline.command.terminal import Terminal  # noqa: E402
from stages.formats.images.photos import write_png8  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent


@dataclass(frozen=True)
class Plan:
    """Sizes, rows and folders of a call.

    Attributes
    ----------
    sweep_size : Size
        Size at which λ and μ are chosen.
    sizes : tuple of Size
        Sizes at which all rows are run with them; the report is about the last one.
    rows : tuple of Row
    workspace : Path
    to : Path
        Folder of the report.
    """

    sweep_size: Size
    sizes: tuple[Size, ...]
    rows: tuple[Row, ...]
    workspace: Path
    to: Path


def main(argv: Sequence[str] | None = None) -> Path:
    """Sweep, run, evaluate and write; returns the page."""
    plan = plan_of(arguments(argv))
    terminal = Terminal()
    bench = Laboratory(plan.workspace / plan.sweep_size.name, plan.sweep_size, terminal)
    sweeps = choose(bench, plan.rows[0])
    experiments = []
    for size in plan.sizes:
        laboratory = Laboratory(plan.workspace / size.name, size, terminal)
        experiments.append(experiment(laboratory, plan.rows, sweeps, plan.to))
    report = write_report(plan.to, sweeps, experiments)
    terminal.say(f"Read {report}")
    return report


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--quick", action="store_true", help="a quarter of the size: minutes, not hours")
    parser.add_argument("--tiny", action="store_true", help="does everything once, too small to mean much")
    parser.add_argument("--rows", help="comma-separated, as in fig3,fig5; all by default")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "paper")
    parser.add_argument("--to", type=Path, help="folder of the report; docs/paper for the full size")
    return parser.parse_args(argv)


def plan_of(given: argparse.Namespace) -> Plan:
    """Plan sizes, rows and folders of a call."""
    names = given.rows.split(",") if given.rows else [row.name for row in ROWS]
    rows = tuple(row for row in ROWS if row.name in names)
    if not rows or rows[0].name != "fig3":
        raise SystemExit(
            f"--rows {given.rows}: expected names among {[r.name for r in ROWS]}, fig3 included."
        )
    workspace = given.workspace
    if given.tiny:
        return Plan(TINY, (TINY,), rows, workspace, given.to or workspace / "tiny-report")
    if given.quick:
        return Plan(TENTH, (QUARTER,), rows, workspace, given.to or workspace / "quick-report")
    return Plan(QUARTER, (QUARTER, FULL), rows, workspace, given.to or ROOT / "docs" / "paper")


def choose(laboratory: Laboratory, row: Row) -> Sweeps:
    """Choose λ and μ of `mode: paper` on the scene of Fig. 3."""
    judge = Judge.of(laboratory.prepare(row))
    tried = sweep_paper(laboratory, row, judge)
    well = sweep_paper(laboratory, row, judge, solved_well=True)
    return Sweeps(laboratory.size, tuple(tried), best(tried), tuple(well), best(well))


def experiment(laboratory: Laboratory, rows: Sequence[Row], sweeps: Sweeps, to: Path) -> Experiment:
    """Run all rows at one size; each picture is written when its row is done."""
    judged, cartoons, noises = [], (), {}
    for row in rows:
        prepared = laboratory.prepare(row)
        judge = Judge.of(prepared)
        noises[row.name] = prepared.facts["render"]
        if not cartoons:
            cartoons = tuple(sweep_cartoon(judge, laboratory.threads))
        fidelity = best(cartoons).fidelity
        estimates = methods(laboratory, row, judge, fidelity, sweeps)
        to.mkdir(parents=True, exist_ok=True)
        write_png8(to / f"{row.name}-{laboratory.size.name}.png", figure(judge, estimates))
        judged.append(Judged(row, tuple(replace(estimate, albedo={}) for estimate in estimates)))
    return Experiment(laboratory.size, tuple(judged), cartoons, best(cartoons), noises)


def methods(
    laboratory: Laboratory, row: Row, judge: Judge, fidelity: float, sweeps: Sweeps
) -> list[Estimate]:
    """Compute every method's estimate of a row."""
    estimates = [image_itself(judge), cartoon(judge, fidelity, laboratory.threads)]
    if laboratory.size.paper_scheme:
        estimates.append(paper(laboratory, row, judge, sweeps.chosen.weights))
    estimates.append(paper(laboratory, row, judge, sweeps.best_solved_well.weights, solved_well=True))
    return estimates


if __name__ == "__main__":
    main()
