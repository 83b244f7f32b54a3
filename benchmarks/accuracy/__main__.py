"""Albedo against truth on many scenes: ``python -m benchmarks.accuracy [--quick] [--rows …] [--to FILE]``.

Renders the scenes (kept in ``workspaces/accuracy``), decomposes them by every method with its defaults, and
writes a page of tables. `--quick` takes the five rows of the paper only; scans need ``UNSHADE_DATA``.
`--ablations` adds `mode: transfer` with one of its parts left out at a time.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: more threads sum in another order

from benchmarks.accuracy.methods import ABLATIONS, METHODS, Judged, judge_row  # noqa: E402
from benchmarks.accuracy.report import page  # noqa: E402
from benchmarks.accuracy.scenes import paper_rows, scan_rows  # noqa: E402
from benchmarks.paper.laboratory import Laboratory  # noqa: E402
from benchmarks.paper.rows import ROWS  # noqa: E402
from pipeline.terminal import Terminal  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent
PAPERS_OWN = ROOT / "workspaces" / "paper"  # where `benchmarks.paper` has rendered the same rows


def main(argv: Sequence[str] | None = None) -> Path:
    """Render, decompose, judge, write; returns the page."""
    given = arguments(argv)
    scenes = list(paper_rows())
    if not given.quick and "UNSHADE_DATA" in os.environ:
        scenes += scan_rows(Path(os.environ["UNSHADE_DATA"]))
    if given.rows:
        scenes = [scene for scene in scenes if scene[0].name in given.rows.split(",")]
    methods = METHODS + (ABLATIONS if given.ablations else ())
    judged: list[Judged] = []
    for row, size in scenes:
        folder = PAPERS_OWN / size.name if row in ROWS else given.workspace / row.name
        laboratory = Laboratory(folder, size, Terminal())
        judged += judge_row(laboratory, row, methods)
        given.to.parent.mkdir(parents=True, exist_ok=True)
        given.to.write_text(page(judged, [method.name for method in methods]), encoding="utf-8")
    return given.to


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """What was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--quick", action="store_true", help="the five rows of the paper only")
    parser.add_argument("--rows", help="comma-separated names; all by default")
    parser.add_argument("--ablations", action="store_true", help="`mode: transfer` with a part left out, too")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "accuracy")
    parser.add_argument("--to", type=Path, default=ROOT / "workspaces" / "accuracy" / "accuracy.md")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
