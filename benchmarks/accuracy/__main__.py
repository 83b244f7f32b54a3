"""Albedo against truth on many scenes: ``python -m benchmarks.accuracy [--quick] [--rows …] [--to FOLDER]``.

Renders the scenes (kept in ``workspaces/accuracy``), decomposes them by every method with its defaults, and
writes ``accuracy.md`` with a picture of each, and ``accuracy.json`` (or ``natural``, ``unseen-SEED``).
`--quick` takes the five rows of the paper only, at a tenth of its size; scans need ``UNSHADE_DATA``.
`--ablations` adds `mode: transfer` with one of its parts left out at a time. `--natural` takes
natural scenes instead, on which methods are developed; `--unseen SEED` draws similar scenes by a seed not
used before. `--tiny` only tests that everything runs.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

from benchmarks.accuracy.methods import ABLATIONS, METHODS, judge_row  # noqa: E402
from benchmarks.accuracy.natural import natural_rows, unseen_rows  # noqa: E402
from benchmarks.accuracy.report import LIKE_THE_WORLD, OF_THE_PAPER_AND_SCANS, UNSEEN, write_report  # noqa: E402
from benchmarks.accuracy.scenes import laboratory_of, paper_rows, scan_rows  # noqa: E402
from benchmarks.paper.laboratory import QUARTER, TENTH, TINY, Size  # noqa: E402
from benchmarks.paper.rows import Row  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent


def main(argv: Sequence[str] | None = None) -> Path:
    """Render, decompose, evaluate and write; returns the page."""
    given = arguments(argv)
    methods = METHODS + (ABLATIONS if given.ablations else ())
    page_and_head = ("accuracy", OF_THE_PAPER_AND_SCANS)
    if given.natural:
        page_and_head = ("natural", LIKE_THE_WORLD)
    elif given.unseen is not None:
        page_and_head = (f"unseen-{given.unseen}", UNSEEN)
    judged = []
    for row, size in scenes_of(given):
        judged.append(judge_row(laboratory_of(row, size, given.workspace), row, methods))
        page = write_report(given.to, judged, *page_and_head)
    return page


def scenes_of(given: argparse.Namespace) -> list[tuple[Row, Size]]:
    """Select the rows to evaluate; refuse unknown ones."""
    data = Path(os.environ["UNSHADE_DATA"]) if "UNSHADE_DATA" in os.environ else None
    if given.natural:
        scenes = list(natural_rows(data))
    elif given.unseen is not None:
        scenes = list(unseen_rows(data, given.unseen))
    else:
        scenes = list(paper_rows(TINY if given.tiny else TENTH if given.quick else QUARTER))
        if not (given.quick or given.tiny) and data is not None:
            scenes += scan_rows(data)
    if given.tiny:
        scenes = [(row, TINY) for row, _ in scenes]
    if given.rows is None:
        return scenes
    known = {row.name: (row, size) for row, size in scenes}
    unknown = [name for name in given.rows.split(",") if name not in known]
    if unknown:
        raise SystemExit(f"--rows {given.rows}: expected names among {', '.join(known)}.")
    return [known[name] for name in given.rows.split(",")]


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--quick", action="store_true", help="the paper's rows only, at a tenth of its size")
    parser.add_argument("--tiny", action="store_true", help="and smaller still, to show that it works")
    parser.add_argument("--natural", action="store_true", help="scenes like the world, to develop on")
    parser.add_argument("--unseen", type=int, metavar="SEED", help="scenes like the world, drawn by seed")
    parser.add_argument("--rows", help="comma-separated names; all by default")
    parser.add_argument("--ablations", action="store_true", help="`mode: transfer` with a part left out, too")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "accuracy")
    parser.add_argument("--to", type=Path, default=ROOT / "workspaces" / "accuracy" / "report")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
