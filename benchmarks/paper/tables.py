"""The tables of the paper beside ours, in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.paper.methods import Estimate
from benchmarks.paper.rows import TABLE_1, Row
from benchmarks.paper.sweep import Tried
from stages.evaluation.judged_views import CHANNELS
from stages.evaluation.scores import Scores


@dataclass(frozen=True, eq=False)
class Judged:
    """A row with every method's estimate."""

    row: Row
    estimates: tuple[Estimate, ...]


def variance_of(scores: Scores, part: str, channel: str) -> float:
    """Look up one cell of Table 1; nan where the row has no such part (a striped shirt)."""
    for cell in scores.variances:
        if (cell.part, cell.channel) == (part, channel):
            return cell.variance
    return float("nan")


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table."""
    lines = [" | ".join(head), " | ".join("---" for _ in head), *(" | ".join(row) for row in rows)]
    return "\n".join(f"| {line} |" for line in lines)


def table_1(judged: Judged) -> str:
    """Tabulate the variance in every part and channel of Fig. 3: the paper's numbers, then ours."""
    head = ["part", "channel", "truth", "paper: its method", "paper: cartoon"]
    head += [estimate.method for estimate in judged.estimates]
    rows = []
    for part, published in TABLE_1.items():
        for k, channel in enumerate(CHANNELS):
            first = judged.estimates[0].scores.variances
            truth = next(c.true_albedo for c in first if (c.part, c.channel) == (part, channel))
            ours = [f"{variance_of(e.scores, part, channel):.6f}" for e in judged.estimates]
            floor = "" if truth >= 0.02 else " (too dark to count)"
            paper = [f"{value:.4f}" for value in published[k]]
            rows.append([part, channel + floor, f"{truth:.4f}", *paper, *ours])
    return markdown(head, rows)


def table_2(all_judged: Sequence[Judged], part: str, channel: str) -> str:
    """Tabulate the variance in one part and channel, all rows."""
    head = ["row", "what", "paper (its bust)", *(e.method for e in all_judged[0].estimates)]
    rows = [
        [
            judged.row.name,
            judged.row.about,
            "–"
            if (part, judged.row.hair_red) == (part, None) or part != "hair"
            else f"{judged.row.hair_red}",
            *(f"{variance_of(e.scores, part, channel):.6f}" for e in judged.estimates),
        ]
        for judged in all_judged
    ]
    return markdown(head, rows)


def table_of_errors(all_judged: Sequence[Judged]) -> str:
    """Tabulate si-RMSE of red, green and blue, LMSE, consistency and leak."""
    head = ["row", "method", "λ, μ", "si-RMSE r g b", "LMSE r g b", "consistency r g b", "leak r g b"]
    rows = []
    for judged in all_judged:
        for estimate in judged.estimates:
            s = estimate.scores
            triples = [s.si_rmse, s.lmse, s.consistency or (float("nan"),) * 3, s.leak]
            rows.append([judged.row.name, estimate.method, estimate.settings, *map(triple, triples)])
    return markdown(head, rows)


def table_of_energies(all_judged: Sequence[Judged]) -> str:
    """Tabulate energy in the gauge, alternations and outcome of every channel."""
    head = ["row", "method", *(f"{channel}: E, alternations, outcome" for channel in CHANNELS)]
    rows = [
        [
            judged.row.name,
            estimate.method,
            *(
                f"{cell['energy']:.0f}, {cell['alternations']}, {cell['outcome']}"
                for cell in estimate.energies.values()
            ),
        ]
        for judged in all_judged
        for estimate in judged.estimates
        if estimate.energies
    ]
    return markdown(head, rows)


def table_of_sweep(tried: Sequence[Tried], chosen: Tried) -> str:
    """Tabulate every point of a grid; the chosen one is marked."""
    head = ["λ, μ", "mean si-RMSE", "si-RMSE r g b", "hair red", "face red", ""]
    rows = [
        [
            one.estimate.settings,
            f"{one.error:.4f}",
            triple(one.estimate.scores.si_rmse),
            f"{variance_of(one.estimate.scores, 'hair', 'red'):.6f}",
            f"{variance_of(one.estimate.scores, 'face', 'red'):.6f}",
            "least" if one is chosen else "",
        ]
        for one in tried
    ]
    return markdown(head, rows)


def triple(values: Sequence[float]) -> str:
    """Format three numbers in one cell."""
    return " ".join(f"{value:.4f}" for value in values)
