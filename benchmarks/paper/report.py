"""`paper.md`: tables and pictures of the paper's experiments, and the same numbers as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.paper.laboratory import Size
from benchmarks.paper.sweep import FIDELITIES, FIRST_AGREEMENT, OTHER_AGREEMENT, SMOOTHNESS, Tried
from benchmarks.paper.tables import (
    Judged,
    table_1,
    table_2,
    table_of_energies,
    table_of_errors,
    table_of_sweep,
)

INTRODUCTION = """# The paper's experiments on our bust

Written by `python -m benchmarks.paper`. The paper's bust, renderer and colour encoding are not public: its
numbers stand beside ours for orientation, to be compared as ratios between methods. Variances are the
paper's: inside each part, over all views, after scaling the part's median to the true value; linear light.
Rendered with Mitsuba 3, path-traced with bounces, exact cameras, geometry known to every method (smoothed in
fig7)."""

RULE = """λ of `mode: paper` is the one of the grid below with the least si-RMSE (mean of the channels) on
Fig. 3 at μ = 1, then μ the best at that λ; both are kept for all rows but where the paper itself divides λ by
12 (Figs. 5 to 7). The paper's scheme, stopped by its own rule, and the same energy solved well have each
their own, by the same rule. The variance cannot choose: an albedo that is constant everywhere, which a large
λ gives, has none. λ is stated as it is at
540×960; at a size s times as large it is s times as much, since the data term counts pixels and the
smoothness lengths; μ stays. Cartoon-texture: the best of its own grid by the same rule, at each size."""


@dataclass(frozen=True, eq=False)
class Sweeps:
    """Choice of λ and μ: for the paper's scheme as it stops, and for its energy solved well."""

    size: Size
    tried: tuple[Tried, ...]
    chosen: Tried
    solved_well: tuple[Tried, ...]
    best_solved_well: Tried


@dataclass(frozen=True, eq=False)
class Experiment:
    """All rows at one size.

    Attributes
    ----------
    size : Size
    judged : tuple of Judged
    cartoons, cartoon : tuple of Tried, Tried
        The baseline's grid on Fig. 3, and the chosen point.
    renders : dict
        Per row, facts of the `render` stage: noise, samples per pixel.
    """

    size: Size
    judged: tuple[Judged, ...]
    cartoons: tuple[Tried, ...]
    cartoon: Tried
    renders: dict[str, dict[str, Any]]


def write_report(to: Path, sweeps: Sweeps, experiments: Sequence[Experiment]) -> Path:
    """Write `paper.md` and `paper.json` into a folder; returns the former."""
    parts = [INTRODUCTION, "## How λ and μ were chosen", RULE, f"At {sweeps.size.name}, `mode: paper`:"]
    parts.append(table_of_sweep(sweeps.tried, sweeps.chosen))
    parts.append("The same energy solved well, which the rows below take at the λ and μ chosen above:")
    parts.append(table_of_sweep(sweeps.solved_well, sweeps.best_solved_well))
    for one in reversed(experiments):
        parts += chapter(one)
    page = to / "paper.md"
    page.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    content = {"sweep": sweep_as_json(sweeps), "sizes": [experiment_as_json(one) for one in experiments]}
    (to / "paper.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return page


def chapter(one: Experiment) -> list[str]:
    """Format the chapter about one size."""
    parts = [f"## {one.size.views} views of {one.size.name}"]
    if one.judged[0].row.name == "fig3":
        parts += ["### Table 1: variance on Fig. 3", table_1(one.judged[0])]
    parts += ["### Table 2: variance of hair, red", table_2(one.judged, "hair", "red")]
    parts += ["The same for the face, red:", table_2(one.judged, "face", "red")]
    parts += ["### Errors", table_of_errors(one.judged)]
    parts += ["### Energies reached (Eq. 2 in the gauge)", table_of_energies(one.judged)]
    parts += ["### Cartoon-texture's λ on Fig. 3", table_of_sweep(one.cartoons, one.cartoon)]
    parts += ["### Renders", renders(one)]
    for judged in one.judged:
        name = f"{judged.row.name}-{one.size.name}.png"
        parts += [f"### {judged.row.name}: {judged.row.about}", f"![{judged.row.about}]({name})"]
    return parts


def renders(one: Experiment) -> str:
    """Format noise and samples of every row, a line each."""
    lines = []
    for name, facts in one.renders.items():
        samples = facts["samples_per_pixel"]
        lines.append(
            f"* {name}: {min(samples)} to {max(samples)} samples per pixel and light source; noise "
            f"{facts['noise']:.4f} of the mean over all views, at most; {facts['faces']} faces."
        )
    return "\n".join(lines)


def sweep_as_json(sweeps: Sweeps) -> dict[str, Any]:
    """Convert the sweep to JSON values."""
    return {
        "grid": {
            "lambda": SMOOTHNESS,
            "mu": (FIRST_AGREEMENT, *OTHER_AGREEMENT),
            "cartoon_lambda": FIDELITIES,
        },
        "chosen": sweeps.chosen.estimate.settings,
        "tried": tried_as_json(sweeps.tried),
        "solved_well": tried_as_json(sweeps.solved_well),
    }


def tried_as_json(tried: Sequence[Tried]) -> list[dict[str, Any]]:
    """Convert points of a grid to JSON values."""
    return [
        {"settings": one.estimate.settings, "error": one.error, "scores": one.estimate.scores.as_json()}
        for one in tried
    ]


def experiment_as_json(one: Experiment) -> dict[str, Any]:
    """Convert one size to JSON values."""
    return {
        "size": one.size.name,
        "renders": one.renders,
        "rows": {
            judged.row.name: [
                {
                    "method": estimate.method,
                    "settings": estimate.settings,
                    "energies": estimate.energies,
                    "scores": estimate.scores.as_json(),
                }
                for estimate in judged.estimates
            ]
            for judged in one.judged
        },
    }
