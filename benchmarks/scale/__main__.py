"""Growth with the number of views: ``python -m benchmarks.scale [--views 10,30] [--from-photos]``.

Renders streets of so many views (kept in ``workspaces/scale``), runs the program on each, and prints and
writes ``scale.md``: every stage's seconds, processor seconds and peak memory, their slopes against the number
of views in logarithms, and the error of the albedo. Cameras and mesh are given, as far as the albedo;
`--from-photos` estimates them, as far as the refined mesh. What follows ``--`` is given to `unshade run`.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

from benchmarks.scale.growth import Grown, grow, own_and_further  # noqa: E402
from benchmarks.scale.photo_set import photo_set  # noqa: E402
from benchmarks.scale.report import page_of  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent


def main(argv: Sequence[str] | None = None) -> list[Grown]:
    """Render, run and write; returns what was measured."""
    given = arguments(argv)
    width_px, height_px = map(int, given.size.split("x"))
    measured: list[Grown] = []
    for views in map(int, given.views.split(",")):
        photos = photo_set(given.workspace / f"{views}-{given.size}", views, width_px, height_px)
        measured.append(grow(photos, given.further, given.from_photos))
        page = page_of(measured, given.size, given.from_photos)
        (given.workspace / "scale.md").write_text(page, encoding="utf-8")
        facts = json.dumps([asdict(one) for one in measured], indent=1)
        (given.workspace / "scale.json").write_text(facts, encoding="utf-8")
    print(page)
    return measured


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse the command line."""
    own, further = own_and_further(argv)
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--views", default="10,30", help="numbers of views, comma-separated")
    parser.add_argument("--size", default="640x400", help="of a view, px")
    parser.add_argument("--from-photos", action="store_true", help="cameras and mesh are estimated")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "scale")
    return parser.parse_args(own, argparse.Namespace(further=further))


if __name__ == "__main__":
    main()
