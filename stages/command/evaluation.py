"""The command `evaluate`: its measures as tables."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rich.table import Table

from pipeline import UserError
from pipeline.command.terminal import Terminal, table_of
from pipeline.process.library_messages import library_messages_in
from stages.command.arguments import Evaluate

if TYPE_CHECKING:
    from stages.evaluation.detail import OctaveDetail, PhotoOctave
    from stages.evaluation.evaluate import Report
    from stages.evaluation.leak import PartLeak
    from stages.evaluation.part_variance import PartVariance
    from stages.evaluation.scores import Scores
    from stages.evaluation.without_truth import PhotoDetail, Stability

MISSING = "–"
Row = dict[str, str]
Cell = TypeVar("Cell", "PartVariance", "PartLeak")


def evaluate_verb(command: Evaluate, terminal: Terminal) -> None:
    """Evaluate a folder of albedo maps against every reference that was given."""
    check_words(command)
    terminal.begin("views", None)
    try:
        with library_messages_in(Path(os.devnull)):
            parts = list(judged_parts(command, terminal.advance))
    finally:
        terminal.end()
    page, answer = Table.grid(), dict[str, Any]()
    for part, tables in parts:
        answer |= part
        for table in tables:
            if page.row_count:
                page.add_row()
            page.add_row(table)
    terminal.answer(answer, page)


def check_words(command: Evaluate) -> None:
    """Refuse options that have no effect without another.

    Raises
    ------
    UserError
        There is no reference, or an option lacks the one that it depends on.
    """
    if not (command.truth or command.photos or command.other_light):
        raise UserError(
            f"There is nothing to judge {command.prediction} by; give a folder of true albedo (TRUTH), of "
            "photos (--photos), or of the same scene's albedo under another light (--other-light)."
        )
    for option, given, needed, there in (
        ("--correspondences", command.correspondences, "TRUTH", command.truth),
        ("--shading", command.shading, "--photos", command.photos),
        ("--other-photos", command.other_photos, "--other-light", command.other_light),
        ("--other-photos", command.other_photos, "--photos", command.photos),
    ):
        if given and not there:
            raise UserError(
                f"{option} {given} says nothing without {needed}; give that too, or leave it out."
            )


def judged_parts(command: Evaluate, step: Callable[[], None]) -> Iterator[tuple[dict[str, Any], list[Table]]]:
    """Compare with the truth, the photos and the other light, as given; yields JSON and tables of each."""
    from stages.evaluation.albedo_folder import open_albedo_folder
    from stages.evaluation.evaluate import evaluate_folders
    from stages.evaluation.without_truth import compare_two_lights, compare_with_photos

    prediction, masks, photos = command.prediction, command.masks, command.photos
    if command.truth:
        report = evaluate_folders(prediction, command.truth, masks, command.correspondences, step)
        yield report.as_json(), tables_of_report(report)
    shading = command.shading or open_albedo_folder(prediction, masks).shading
    if photos and (shading or not command.other_photos):  # else they serve only the other light
        detail = compare_with_photos(prediction, photos, shading, masks, step)
        yield {"detail_against_photos": detail.as_json()}, tables_of_photo_detail(detail)
    if command.other_light:
        both = (photos, command.other_photos) if photos and command.other_photos else None
        stability = compare_two_lights(prediction, command.other_light, both, masks, step)
        yield {"stability": stability.as_json()}, tables_of_stability(stability)


def tables_of_report(report: Report) -> list[Table]:
    """Build tables of the facts, the scores, the detail and the remarks."""
    columns = {"": "measure", "red": "red", "green": "green", "blue": "blue"}
    remarks = [{"remark": sentence} for sentence in (*report.notes, *report.scores.remarks())]
    return [
        table_of(fact_rows(report), {"": "what", " ": "value"}),
        table_of(score_rows(report.scores), columns),
        octave_table("detail, truth", report.scores.detail, "error", "gain"),
        table_of(remarks, {"": "remark"}),
    ]


def octave_table(title: str, octaves: Sequence[OctaveDetail | PhotoOctave], *measures: str) -> Table:
    """Build a table with a row per octave, and columns for each measure of brightness and of chroma."""
    names = [f"{kind}_{measure}" for kind in ("brightness", "chroma") for measure in measures]
    rows = [
        {"octave": f"σ {one.sigma_low_px:g}–{one.sigma_high_px:g} px"}
        | {name: number(getattr(one, name), 3) for name in names}
        for one in octaves
    ]
    return table_of(rows, {title: "octave"} | {name.replace("_", " "): name for name in names})


def tables_of_photo_detail(detail: PhotoDetail) -> list[Table]:
    """Build tables of the number of pixels compared, and of gain per octave with its share of pixels."""
    said = f"detail against the photos: {detail.pixels} pixels in {detail.views} view(s)"
    return [
        table_of([{"remark": said}], {"": "remark"}),
        octave_table("detail, photos", detail.octaves, "gain", "share"),
    ]


def tables_of_stability(stability: Stability) -> list[Table]:
    """Build tables of differences under two lights: RMS after one scale per channel, over the mean."""
    from stages.scene.wording import listed

    said = f"two lights: {stability.pixels} pixels in {stability.views} view(s)"
    if stability.left_out:
        said += f"; in one folder only, and not compared: {listed(stability.left_out)}"
    rows = [row("albedo, RMS/mean", stability.albedo, 4)]
    if stability.photos is not None and stability.ratio is not None:
        rows += [row("photos, RMS/mean", stability.photos, 4), row("albedo/photos", stability.ratio, 4)]
    columns = {"two lights": "measure", "red": "red", "green": "green", "blue": "blue"}
    return [table_of([{"remark": said}], {"": "remark"}), table_of(rows, columns)]


def fact_rows(report: Report) -> list[Row]:
    """List what was compared, and how."""
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
    """Build a row per measure, a column per channel; a star marks variances that enter no ratio."""
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
    """Format a variance with six digits, and a star where it enters no ratio."""
    return number(cell.variance, 6) + ("" if cell.enters_ratios or math.isnan(cell.variance) else "*")


def by_part(cells: tuple[Cell, ...]) -> dict[str, list[Cell]]:
    """Group cells by part, in order."""
    parts: dict[str, list[Cell]] = {}
    for cell in cells:
        parts.setdefault(cell.part, []).append(cell)
    return parts


def row(measure: str, values: tuple[float, ...], digits: int) -> Row:
    """Build the row of one measure in the three channels."""
    from stages.evaluation.scores import by_channel

    cells = {channel: number(value, digits) for channel, value in by_channel(values).items()}
    return {"measure": measure} | cells


def number(value: float, digits: int) -> str:
    """Format a number, or the sign for a missing one."""
    return f"{value:.{digits}f}" if math.isfinite(value) else MISSING
