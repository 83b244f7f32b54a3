"""The page of `benchmarks.accuracy`: what every method reaches, scene by scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.accuracy.methods import OURS, PAPER, Judged
from benchmarks.paper.tables import markdown

LEAST_VARIANCE = 5e-4  # of the method compared with: below, a ratio says nothing (EVALUATION)
HEAD = """# Albedo against truth, scene by scene

Written by `python -m benchmarks.accuracy`. Linear values; si-RMSE after one scale per channel for all views.
Every method has the λ and μ that are best on Fig. 3 by the same rule (docs/paper), kept for all scenes but
where the paper itself divides λ by 12 (Figs. 5 to 7); `mode: transfer` has its defaults, everywhere.
"""


def page(judged: Sequence[Judged], methods: Sequence[str]) -> str:
    """The whole page."""
    rows = list(dict.fromkeys(one.row for one in judged))
    by_place = {(one.row, one.method): one for one in judged}
    parts = [HEAD, "## si-RMSE (red green blue)", _triples(rows, methods, by_place, "si_rmse", 4)]
    parts += ["## Leak of the shading (slope)", _triples(rows, methods, by_place, "leak", 2)]
    if all((row, name) in by_place for row in rows for name in (OURS.name, PAPER.name)):
        parts += ["## `mode: transfer` against `mode: paper` and the image", _ratios(rows, by_place)]
    parts += [
        "## Seconds of the decomposition (0 where it was there already)",
        _seconds(rows, methods, by_place),
    ]
    return "\n\n".join(parts) + "\n"


def _triples(rows, methods, by_place, measure: str, digits: int) -> str:
    """A measure of red, green and blue, scene by scene."""
    table = []
    for row in rows:
        triples = [getattr(by_place[row, name].scores, measure) for name in methods]
        table.append([row, *(" ".join(f"{value:.{digits}f}" for value in triple) for triple in triples)])
    return markdown(["scene", *methods], table)


def _ratios(rows, by_place) -> str:
    table = []
    for row in rows:
        ours, paper, image = (
            by_place[row, name].scores for name in (OURS.name, PAPER.name, "the image itself")
        )
        error = np.mean(ours.si_rmse) / np.mean(paper.si_rmse)
        worst = max(np.array(ours.si_rmse) / np.array(image.si_rmse))
        variances = _variance_ratios(ours, paper)
        facts = by_place[row, OURS.name].facts
        table.append(
            [
                row,
                f"{error:.2f}",
                f"{worst:.2f}",
                "–" if not variances else f"{max(variances):.2f} ({np.median(variances):.2f})",
                str(facts.get("light_distance", "")),
            ]
        )
    head = ["scene", "si-RMSE / paper's", "worst channel / image's", "variance / paper's: worst (median)"]
    return markdown([*head, "light's distance"], table)


def _variance_ratios(ours, paper) -> list[float]:
    """Of all parts and channels that count."""
    return [
        mine.variance / theirs.variance
        for mine, theirs in zip(ours.variances, paper.variances, strict=True)
        if theirs.enters_ratios and theirs.variance >= LEAST_VARIANCE
    ]


def _seconds(rows, methods, by_place) -> str:
    return markdown(
        ["scene", *methods],
        [[row, *(f"{by_place[row, name].seconds:.0f}" for name in methods)] for row in rows],
    )
