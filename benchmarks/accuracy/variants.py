"""Other settings against the defaults: ``python -m benchmarks.accuracy.variants --rows … "KEY=VALUE …" …``.

Decomposes rows of `benchmarks.accuracy` (with or without ``--natural``) by the defaults and by each variant:
settings of `correspondence`, `lighting` and `decomposition` as for `unshade run --set`, with a space between
them. Prints and writes ``variants.md``: si-RMSE, it and the error of detail over those by default, and the
gain of detail, row by row and over all rows. `--views` renders another number of views.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

import numpy as np  # noqa: E402

from benchmarks.accuracy.natural import natural_rows  # noqa: E402
from benchmarks.accuracy.scenes import laboratory_of, paper_rows, scan_rows  # noqa: E402
from benchmarks.paper.judging import Judge, maps_in  # noqa: E402
from benchmarks.paper.laboratory import Laboratory, Size  # noqa: E402
from benchmarks.paper.rows import Row  # noqa: E402
from benchmarks.paper.tables import markdown  # noqa: E402
from pipeline.config import override  # noqa: E402
from stages.evaluation.scores import Scores  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent
HEAD = """# Other settings against the defaults

Written by `python -m benchmarks.accuracy.variants`. si-RMSE (mean of the channels); it and the error of
detail (mean of five octaves of log brightness) over those by default; gain of detail (finest octave, mean of
the others)."""
Compared = tuple[float, float, float, float, float]  # the columns of the page


def known_rows() -> dict[str, tuple[Row, Size]]:
    """List all rows, the paper's, the scans and the natural ones, by name."""
    data = Path(os.environ["UNSHADE_DATA"]) if "UNSHADE_DATA" in os.environ else None
    scans = scan_rows(data) if data else ()
    return {row.name: (row, size) for row, size in (*paper_rows(), *scans, *natural_rows(data))}


def scores_of(laboratory: Laboratory, row: Row, variant: str) -> Scores:
    """Decompose a row by default or with the settings of a variant, and evaluate the albedo."""
    given = override({"decomposition": {"mode": "transfer"}}, variant.split())
    results = laboratory.run_with(
        row, given["decomposition"], given.get("lighting"), given.get("correspondence")
    )
    judge = Judge.of(laboratory.prepare(row))
    return judge.scores(maps_in(results.paths["albedo"], judge.names))


def compared(scores: Scores, usual: Scores) -> Compared:
    """Compare: si-RMSE, it and error of detail over those by default, gain of finest octave and others."""
    error = float(np.mean(scores.si_rmse))
    ratio = error / float(np.mean(usual.si_rmse))
    errors = [np.nanmean([one.brightness_error for one in of.detail]) for of in (scores, usual)]
    gains = [one.brightness_gain for one in scores.detail]
    return error, ratio, float(errors[0] / errors[1]), gains[0], float(np.nanmean(gains[1:]))


def page(found: dict[str, dict[str, Compared]]) -> str:
    """Format a line per row and variant, and the geometric mean of each variant's ratios over the rows."""
    table = [
        [row, f"`{variant or 'defaults'}`", *(f"{number:.4f}" for number in numbers)]
        for row, variants in found.items()
        for variant, numbers in variants.items()
    ]
    for variant in next(iter(found.values())):
        ratios = np.array([of[variant][1:3] for of in found.values() if variant in of])
        mean = np.exp(np.nanmean(np.log(ratios), axis=0))
        means = [f"{one:.4f}" for one in mean]
        table.append(["all, geometric mean", f"`{variant or 'defaults'}`", "", *means, "", ""])
    head = ["row", "settings", "si-RMSE", "over default", "detail", "gain, finest", "gain, others"]
    return f"{HEAD}\n\n{markdown(head, table)}\n"


def main(argv: Sequence[str] | None = None) -> Path:
    """Decompose every row by every variant, evaluate and write; returns the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("variants", nargs="+", help="settings, as in 'decomposition.detail.window=3'")
    parser.add_argument("--rows", required=True, help="comma-separated names of rows")
    parser.add_argument("--views", type=int, help="number of views to render, where not the row's own")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "accuracy")
    parser.add_argument("--to", type=Path, default=ROOT / "workspaces" / "accuracy" / "variants.md")
    given = parser.parse_args(argv)
    rows, found = known_rows(), {}
    unknown = [name for name in given.rows.split(",") if name not in rows]
    if unknown:
        raise SystemExit(f"--rows {','.join(unknown)}: expected names among {', '.join(rows)}.")
    given.to.parent.mkdir(parents=True, exist_ok=True)
    for name in given.rows.split(","):
        row, size = rows[name]
        laboratory = laboratory_of(row, size, given.workspace)
        if given.views:
            folder = given.workspace / f"{name}-{given.views}"
            laboratory = replace(laboratory, workspace=folder, size=replace(size, views=given.views))
        usual = scores_of(laboratory, row, "")
        found[name] = {"": compared(usual, usual)}
        for variant in given.variants:
            found[name][variant] = compared(scores_of(laboratory, row, variant), usual)
        given.to.write_text(page(found), encoding="utf-8")
    print(page(found))
    return given.to


if __name__ == "__main__":
    main()
