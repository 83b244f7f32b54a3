"""`solver.md` with its pictures, and the same numbers as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.paper.tables import markdown
from benchmarks.solver.comparison import Comparison
from benchmarks.solver.growth import Grown, slope
from benchmarks.solver.picture import chart
from benchmarks.solver.racing import Race, Rules
from benchmarks.solver.scaling import ROUNDS, ThreadedSpeed
from stages.formats.images.photos import write_png8

INTRODUCTION = """# The decomposition's solvers: energy against time

Written by `python -m benchmarks.solver`. Energies are Eq. 2's, all channels together, in the gauge.
`near` is the time to within 1 % of the best energy that any method of the run saw. The ratio says how
many times as long as ours a method takes to the same energy: to that one, or, where it never gets
there, to its own least; ≥ where ours was below that when first looked at. The paper's scheme and its
variants (same alternation, other inner solver; relative residual 1e-6) run until the budget ends, not
by the paper's stopping rule. Looking at their energies is not counted, looking at ours is. `compiled
PCG` does 20 matrix-free steps per alternation, in float32, on our graph."""

KERNEL = f"""An iteration's compulsory bytes (every array that it reads or writes counts once for each)
per second, beside what as many threads copy of a large array (bytes read plus bytes written); and
seconds of graph, pyramid and {ROUNDS} rounds."""

GROWTH = """Corrugated planes, solved by ours until its own rule or the limit of rounds ends it, each in
a fresh process. Peak: how far the process's peak resident memory rose from before the problem was made:
what every solver is given (basis of normals, differences, links, images; `given` is how much of the
peak was reached by then) and what ours adds."""


@dataclass(frozen=True)
class Findings:
    """All of a run."""

    rules: Rules
    races: tuple[Race, ...]
    speeds: tuple[ThreadedSpeed, ...]
    grown: tuple[Grown, ...]
    left_out: tuple[str, ...]


def write_report(to: Path, found: Findings) -> Path:
    """Write page, pictures and JSON into a folder; returns the page."""
    to.mkdir(parents=True, exist_ok=True)
    for race in found.races:
        write_png8(to / f"{race.problem.name}.png", chart(race.problem.about, race.traces))
    page = to / "solver.md"
    page.write_text(text_of(found), encoding="utf-8")
    page.with_suffix(".json").write_text(json.dumps(as_json(found), indent=1) + "\n", encoding="utf-8")
    return page


def text_of(found: Findings) -> str:
    """Format the page."""
    rules = found.rules
    parts = [INTRODUCTION, f"{rules.threads} threads, {rules.budget_s:g} s for every method."]
    parts += [f"* {sentence}" for sentence in found.left_out]
    for race in found.races:
        weights, name = race.problem.weights, race.problem.name
        parts += [f"## {race.problem.about}, λ = {weights.smoothness:g}, μ = {weights.consistency:g}"]
        parts += [table_of_race(race), f"![Energy against time]({name}.png)"]
    parts += ["## Inner loop, one thread and more", KERNEL, table_of_speeds(found.speeds)]
    if found.grown:
        parts += ["## Growing graphs", GROWTH, table_of_growth(found.grown)]
    if len(found.grown) > 1:
        parts += [sentence_of_growth(found.grown)]
    return "\n\n".join(parts) + "\n"


def table_of_race(race: Race) -> str:
    """Tabulate a row per method."""
    head = ["method", "looks", "least energy", "above best", "near, s", "ratio to ours", "at energy"]
    rows = [
        [
            one.method,
            f"{one.looks}",
            f"{one.least:.6g}",
            f"{100 * one.above_best:.2f} %",
            _number(one.near_s),
            _ratio(one),
            f"{one.common:.6g}",
        ]
        for one in race.comparisons
    ]
    return markdown(head, rows)


def table_of_speeds(speeds: Sequence[ThreadedSpeed]) -> str:
    """Tabulate a row per problem and number of threads."""
    head = [
        "problem",
        "threads",
        "iteration, ms",
        "MB",
        "GB/s",
        "copy, GB/s",
        "share",
        "solve, s",
        "against one thread",
    ]
    alone = {speed.problem: speed.solve_s for speed in speeds if speed.kernel.threads == 1}
    rows = [
        [
            speed.problem,
            f"{speed.kernel.threads}",
            f"{1e3 * speed.kernel.iteration_s:.3g}",
            f"{speed.kernel.iteration_bytes / 1e6:.3g}",
            f"{speed.kernel.bytes_per_s / 1e9:.2f}",
            f"{speed.kernel.copied_bytes_per_s / 1e9:.2f}",
            f"{100 * speed.kernel.share:.0f} %",
            f"{speed.solve_s:.2f}",
            f"{alone[speed.problem] / speed.solve_s:.2f}×",
        ]
        for speed in speeds
    ]
    return markdown(head, rows)


def table_of_growth(grown: Sequence[Grown]) -> str:
    """Tabulate a row per size."""
    head = [
        "pixels",
        "seconds",
        "to 1 %, s",
        "iterations",
        "outcome",
        "peak, MB",
        "given, MB",
        "bytes per pixel and channel",
    ]
    rows = [
        [
            f"{one.pixels}",
            f"{one.seconds:.2f}",
            f"{one.close_s:.2f}",
            f"{one.iterations}",
            one.outcome,
            f"{one.peak_bytes / 1e6:.0f}",
            f"{one.given_bytes / 1e6:.0f}",
            f"{one.peak_per_value:.0f}",
        ]
        for one in grown
    ]
    return markdown(head, rows)


def sentence_of_growth(grown: Sequence[Grown]) -> str:
    """Format the slopes."""
    slopes = slopes_of(grown)
    return (
        f"Log-log slopes against the number of pixels: seconds {slopes['seconds']:.2f}, seconds to 1 % "
        f"{slopes['close_s']:.2f}, seconds per iteration {slopes['iteration_s']:.2f}, peak memory "
        f"{slopes['peak_bytes']:.2f}."
    )


def slopes_of(grown: Sequence[Grown]) -> dict[str, float]:
    """Compute the slopes of time and memory."""
    sizes = [one.pixels for one in grown]
    return {
        "seconds": slope(sizes, [one.seconds for one in grown]),
        "close_s": slope(sizes, [one.close_s for one in grown]),
        "iteration_s": slope(sizes, [one.seconds / one.iterations for one in grown]),
        "peak_bytes": slope(sizes, [one.peak_bytes for one in grown]),
    }


def as_json(found: Findings) -> dict[str, Any]:
    """Convert all findings to JSON values."""
    return {
        "rules": asdict(found.rules),
        "races": [
            {
                "problem": race.problem.name,
                "about": race.problem.about,
                "pixels": race.problem.pixels,
                "links": race.problem.views.correspondence_count,
                "lambda": race.problem.weights.smoothness,
                "mu": race.problem.weights.consistency,
                "comparisons": [asdict(one) | {"ratio": one.ratio} for one in race.comparisons],
                "traces": {t.method: [[look.seconds, look.energy] for look in t.looks] for t in race.traces},
            }
            for race in found.races
        ],
        "speeds": [
            asdict(speed) | {"bytes_per_s": speed.kernel.bytes_per_s, "share": speed.kernel.share}
            for speed in found.speeds
        ],
        "growth": [asdict(one) | {"peak_per_value": one.peak_per_value} for one in found.grown],
        "slopes": slopes_of(found.grown) if len(found.grown) > 1 else {},
        "left_out": list(found.left_out),
    }


def _ratio(one: Comparison) -> str:
    if one.ratio is None:
        return "–"
    where = "" if one.near_s is not None else ", at its own least"
    return f"{'≥ ' if one.at_least else ''}{one.ratio:.3g}{where}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"
