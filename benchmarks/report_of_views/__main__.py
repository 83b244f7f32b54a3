"""Time, memory and size of the report of many views: ``python -m benchmarks.report_of_views [--views 100]``.

Makes results of so many views (kept in ``workspaces/report_of_views``), runs the stage `report` on them in
a process of its own, puts the page together, and prints processor seconds, peak memory, the side of the
pictures and the size of the page. Loops are compiled in the first run: the second is the one to quote.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy, as the command line does

from benchmarks.report_of_views.measuring import Taken, measured, sentence_of  # noqa: E402
from benchmarks.report_of_views.repeated_views import repeated_views  # noqa: E402
from pipeline.process.own_process import in_own_process  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent


def main(argv: Sequence[str] | None = None) -> Taken:
    """Make the views, measure, print; returns what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--views", type=int, default=100)
    parser.add_argument("--distinct", type=int, default=5, help="views of which the others are copies")
    parser.add_argument("--size", default="3000x2000", help="of a view, px")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "report_of_views")
    given = parser.parse_args(argv)
    width_px, height_px = map(int, given.size.split("x"))
    folder = given.workspace / f"{given.views}-{given.distinct}-{given.size}"
    # Each in a process of its own: the peak of one is not that of the other.
    shape = given.views, given.distinct, width_px, height_px
    places = in_own_process("that makes the views", repeated_views, folder, *shape)
    taken = in_own_process("that makes the report", measured, places, folder, given.threads)
    print(sentence_of(taken))
    return taken


if __name__ == "__main__":
    main()
