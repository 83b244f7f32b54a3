"""The page of `benchmarks.accuracy`: scores of every method, scene by scene."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy.methods import IMAGE, OURS, PAPER, Judged, JudgedRow
from benchmarks.paper.tables import markdown
from stages.evaluation.judged_views import above_floor
from stages.evaluation.part_variance import PartVariance, variance_ratios
from stages.formats.images.photos import write_png8
from stages.transfer import TransferSettings

OF_THE_PAPER_AND_SCANS = """# Albedo against truth, scene by scene

Written by `python -m benchmarks.accuracy`. The defaults of `mode: transfer` were decided on scenes of this
page, on those of `--natural` and on three photographed objects (benchmarks.mit_berkeley). Lamps (four, one,
Figs. 4 to 7) stand four radii away, all other light is infinitely far."""
LIKE_THE_WORLD = """# Albedo against truth: scenes like the world

Written by `python -m benchmarks.accuracy --natural`. Stone, wood, rust, stains, prints, plaster under skies
and in rooms; the defaults of `mode: transfer` were decided on scenes of this page, too."""
UNSEEN = """# Albedo against truth: scenes that nobody had looked at

Written by `python -m benchmarks.accuracy --unseen SEED`, once: nothing was decided on them."""
HOW_TO_READ = """Linear values; si-RMSE after one scale per channel for all views. Every method has the λ
and μ that are best on Fig. 3 by the same rule (docs/paper), kept for all scenes but where the paper itself
divides λ by 12 (Figs. 5 to 7); `mode: transfer` has its defaults, everywhere. So stripes and fine paint
have the λ of flat paint, with which the paper's energy often does worse than the image itself: compare with
that as well. Leak: slope of log albedo on log true shading inside parts of one paint; scenes without such
parts have none. Detail: bands of log brightness inside the masks; error 0 and gain 1 at best, 1 and 0 for a
flat albedo, – where the truth has no such detail."""
RELIABILITY = """Pixels in fifths, the least confident first. Held: share of the squared error. Then per fifth
the relative error of brightness, root mean square, and in brackets the median of what the confidence c stands
for, 0.1 √(1/c − 1); ∞ for pixels whose data did not count."""


def write_report(to: Path, rows: Sequence[JudgedRow], name: str, head: str) -> Path:
    """Write a page under a head, its numbers as JSON, a picture per row into a folder; returns the page."""
    to.mkdir(parents=True, exist_ok=True)
    for row in rows:
        write_png8(to / f"{row.name}.png", row.picture)
    numbers = {row.name: {one.method: one.as_json() for one in row.judged} for row in rows}
    (to / f"{name}.json").write_text(json.dumps(numbers, indent=1), encoding="utf-8")
    page = to / f"{name}.md"
    page.write_text(page_of(rows, head), encoding="utf-8")
    return page


def page_of(rows: Sequence[JudgedRow], head: str) -> str:
    """Format the whole page, without its pictures."""
    parts = [
        head,
        HOW_TO_READ,
        "## si-RMSE (red green blue)",
        _table(rows, lambda one: _numbers(one.scores.si_rmse, 3)),
        f"## Detail: error of log brightness per octave ({_octaves(rows)})",
        _table(rows, lambda one: _numbers([octave.brightness_error for octave in one.scores.detail], 2)),
        "## Detail: gain of log brightness per octave (the same)",
        _table(rows, lambda one: _numbers([octave.brightness_gain for octave in one.scores.detail], 2)),
        "## Leak of the shading (slope)",
        _table(rows, lambda one: _numbers(one.scores.leak, 2)),
        "## `mode: transfer` against `mode: paper` and the image",
        _ratios(rows),
        "## Confidence of `mode: transfer`",
        RELIABILITY,
        _reliability(rows),
        "## Seconds (the first that needs it makes `transfer`, too; 0 where all was there already)",
        _table(rows, lambda one: f"{one.seconds:.0f}"),
        "## Pictures",
        *(f"{row.name}: {row.about}\n\n![{row.name}]({row.name}.png)" for row in rows),
    ]
    return "\n\n".join(parts) + "\n"


def _table(rows: Sequence[JudgedRow], cell: Callable[[Judged], str]) -> str:
    methods = [one.method for one in rows[0].judged]
    return markdown(["scene", *methods], [[row.name, *map(cell, row.judged)] for row in rows])


def _reliability(rows: Sequence[JudgedRow]) -> str:
    table = []
    for row in rows:
        told = row.by(OURS).reliability
        errors = (
            f"{measured:.3f} ({expected:.3f})" if np.isfinite(expected) else f"{measured:.3f} (∞)"
            for measured, expected in zip(told.measured, told.expected, strict=True)
        )
        table.append([row.name, _numbers(told.held, 2), *errors])
    return markdown(["scene", "held", "least confident", "second", "third", "fourth", "most"], table)


def _numbers(values: Sequence[float], digits: int) -> str:
    return " ".join("–" if np.isnan(value) else f"{value:.{digits}f}" for value in values)


def _octaves(rows: Sequence[JudgedRow]) -> str:
    octaves = rows[0].judged[0].scores.detail
    return "σ " + ", ".join(f"{one.sigma_low_px:g}–{one.sigma_high_px:g}" for one in octaves) + " px"


def _ratios(rows: Sequence[JudgedRow]) -> str:
    table = []
    for row in rows:
        ours, paper, image = (row.by(method).scores for method in (OURS, PAPER, IMAGE))
        cells = [
            f"{np.mean(ours.si_rmse) / np.mean(paper.si_rmse):.2f}",
            f"{max(np.array(ours.si_rmse) / np.array(image.si_rmse)):.2f}",
            worst_variance(ours.variances, paper.variances),
            light_distance(row.by(OURS).facts),
        ]
        table.append([row.name, *cells])
    head = ["scene", "si-RMSE / paper's", "worst channel / image's", "variance / paper's: worst (median)"]
    return markdown([*head, "light's distance"], table)


def light_distance(facts: Mapping[str, Any]) -> str:
    """Format the estimated distance of the light, in radii of the scene: that of its nearest sphere."""
    found = facts.get("light_distance", "")
    if isinstance(found, str):
        return found
    nearest = min(map(float, facts["disagreement"]))
    return f"{found / nearest * min(TransferSettings().light_distances):.0f} radii"


def worst_variance(ours: Sequence[PartVariance], paper: Sequence[PartVariance]) -> str:
    """Format the largest and median variance ratio of parts and channels, and the number without one."""
    ratios = [one.ratio for one in variance_ratios(ours, paper) if not np.isnan(one.ratio)]
    unknown = sum(np.isnan(one.variance) and above_floor(one.true_albedo) for one in ours)
    said = f"{max(ratios):.2f} ({np.median(ratios):.2f})" if ratios else "–"
    return said + f", {unknown} unknown" * bool(unknown)
