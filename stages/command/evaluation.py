"""The verb `evaluate`: what it measured, as tables for people."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.table import Table

from pipeline.terminal import Terminal, table_of
from stages.command.words import Evaluate

if TYPE_CHECKING:
    from stages.evaluation.evaluate import Report
    from stages.evaluation.part_variance import PartVariance
    from stages.evaluation.scores import Scores

MISSING = "–"
Row = dict[str, str]


def evaluate_verb(command: Evaluate, terminal: Terminal) -> None:
    """Judge a folder of albedo maps against the truth."""
    from stages.evaluation.evaluate import evaluate_folders

    terminal.begin("views", None)
    try:
        report = evaluate_folders(
            command.prediction, command.truth, command.masks, command.correspondences, terminal.advance
        )
    finally:
        terminal.end()
    terminal.answer(report.as_json(), table_of_report(report))


def table_of_report(report: Report) -> Table:
    """The facts, the numbers, and what is to be said about them, one below the other."""
    page = Table.grid()
    page.add_row(table_of(fact_rows(report), {"": "what", " ": "value"}))
    columns = {"": "measure", "red": "red", "green": "green", "blue": "blue"}
    page.add_row()
    page.add_row(table_of(score_rows(report.scores), columns))
    page.add_row()
    remarks = [{"remark": sentence} for sentence in (*report.notes, *report.scores.remarks())]
    page.add_row(table_of(remarks, {"": "remark"}))
    return page


def fact_rows(report: Report) -> list[Row]:
    """What was compared, and how."""
    from stages.evaluation.scores import SCALING
    from stages.scene.wording import listed

    scores = report.scores
    coverage = MISSING if math.isnan(report.coverage) else f"{report.coverage:.1%} of the truth's masks"
    facts = {
        "prediction": report.prediction_space,
        "truth": report.truth_space,
        "scaling": SCALING,
        "judged": f"{scores.pixels} pixels in {scores.views} view(s)",
        "coverage": coverage,
        "only in the prediction": listed(report.only_in_prediction) or MISSING,
        "only in the truth": listed(report.only_in_truth) or MISSING,
    }
    return [{"what": what, "value": value} for what, value in facts.items()]


def score_rows(scores: Scores) -> list[Row]:
    """A row per measure, a column per channel; a star where a variance enters no ratio."""
    rows = [
        {"measure": f"variance, {part}"} | {cell.channel: variance_cell(cell) for cell in cells}
        for part, cells in by_part(scores.variances).items()
    ]
    rows += [row("si-RMSE", scores.si_rmse, 5), row("LMSE", scores.lmse, 5)]
    if scores.leaks:
        rows.append(row("leak", scores.leak, 3))
    for part, cells in by_part(scores.leaks).items():
        rows.append({"measure": f"leak, {part}"} | {cell.channel: number(cell.slope, 3) for cell in cells})
    if scores.consistency is not None:
        rows.append(row(f"consistency, {scores.links} links", scores.consistency, 5))
    psnr = "∞" if scores.psnr_h == math.inf else number(scores.psnr_h, 2)
    return [*rows, {"measure": "PSNR-H, dB, all channels", "red": psnr, "green": "", "blue": ""}]


def variance_cell(cell: PartVariance) -> str:
    """Six digits."""
    return number(cell.variance, 6) + ("" if cell.enters_ratios or math.isnan(cell.variance) else "*")


def by_part(cells: tuple) -> dict[str, list]:
    """Cells of each part, in order."""
    parts: dict[str, list] = {}
    for cell in cells:
        parts.setdefault(cell.part, []).append(cell)
    return parts


def row(measure: str, values: tuple[float, ...], digits: int) -> Row:
    """One measure of the three channels."""
    from stages.evaluation.scores import by_channel

    cells = {channel: number(value, digits) for channel, value in by_channel(values).items()}
    return {"measure": measure} | cells


def number(value: float, digits: int) -> str:
    """A number, or that there is none."""
    return f"{value:.{digits}f}" if math.isfinite(value) else MISSING
