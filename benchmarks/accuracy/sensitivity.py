"""Sensitivity to each setting: ``python -m benchmarks.accuracy.sensitivity [--stages …] [--to FOLDER]``.

Every number of the settings of `lighting` and `decomposition` is made 30 % smaller and 30 % larger, alone, on
the stored scenes of `tests/accuracy_scenes`; writes ``sensitivity.md`` with si-RMSE and the error of the
detail relative to those by default. Takes hours; finished runs are reused from the workspace.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

import numpy as np  # noqa: E402

from benchmarks.accuracy.stored_scene import FEWER, StoredScene  # noqa: E402
from benchmarks.paper.tables import markdown  # noqa: E402
from pipeline.config import check_settings, override  # noqa: E402
from pipeline.errors import UserError  # noqa: E402
from pipeline.settings import settings_that_matter  # noqa: E402
from stages.decomposition_under_light import DECOMPOSITION_UNDER_LIGHT  # noqa: E402
from stages.evaluation.scores import Scores  # noqa: E402
from stages.lighting import LIGHTING  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent
SCENES = ("relief", "bust", "courtyard")
FACTORS = (0.7, 1.3)
Change = tuple[float, float, float]  # as `Judged.over` gives it
NEARER = (1.0, 0.5, 0.2)  # shares of a change that are tried in turn, until the bounds allow one
STAGES = {stage.name: stage for stage in (LIGHTING, DECOMPOSITION_UNDER_LIGHT)}
HEAD = """# What each number is worth

Written by `python -m benchmarks.accuracy.sensitivity`. Each number of the settings alone, 30 % smaller
and 30 % larger (whole numbers by at least one; lists as a whole; where the bounds refuse that, by half or
a fifth of it; – where they refuse all), on stored scenes of `tests/accuracy_scenes`: {scenes} (relief:
under sun and sky; bust: glossy; courtyard: of smoothed geometry). Shown is the mean over the scenes of
si-RMSE and of the error of detail (five octaves of log brightness), over that by default, and si-RMSE of
the scene that changes most. Numbers that change no scene's si-RMSE by half a per cent are listed below
the table."""


@dataclass(frozen=True)
class Judged:
    """Mean si-RMSE of the channels, and mean error of the octaves, by scene."""

    si_rmse: tuple[float, ...]
    detail: tuple[float, ...]

    @classmethod
    def of(cls, scores: Sequence[Scores]) -> Judged:
        """Summarise the scores of all scenes."""
        return cls(
            tuple(float(np.mean(one.si_rmse)) for one in scores),
            tuple(float(np.mean([octave.brightness_error for octave in one.detail])) for one in scores),
        )

    def over(self, usual: Judged) -> Change:
        """Compare: geometric mean of si-RMSE ratios, that of the scene that changes most, that of detail."""
        ratios = np.log(np.array(self.si_rmse) / usual.si_rmse)
        detail = np.log(np.array(self.detail) / usual.detail)
        most = ratios[np.argmax(np.abs(ratios))]
        return float(np.exp(ratios.mean())), float(np.exp(most)), float(np.exp(detail.mean()))


def changed(value: Any, factor: float) -> Any:
    """Multiply a number, or a list of them, by a factor; integers change by at least one."""
    if isinstance(value, list):
        return [changed(one, factor) for one in value]
    if isinstance(value, int):
        return round(value * factor) if abs(value * (factor - 1)) >= 1 else value + (1 if factor > 1 else -1)
    return float(f"{value * factor:.6g}")


def is_number(value: Any) -> bool:
    """Check for a number, or a list of numbers, that is not 0."""
    if isinstance(value, list):
        return bool(value) and all(is_number(one) for one in value)
    return isinstance(value, int | float) and not isinstance(value, bool) and value != 0


def numbers_of(stage: str) -> dict[str, Any]:
    """List the numbers among a stage's settings, by name; `samples`, which sets only time, is left out."""
    declared = STAGES[stage]
    values = settings_that_matter(declared.settings(), declared.ignores)
    return {name: value for name, value in values.items() if is_number(value) and name != "samples"}


def within_bounds(stage: str, name: str, default: Any, factor: float) -> dict[str, dict[str, Any]] | None:
    """Set a number changed by this factor, or by one nearer 1 where that is refused; None if all are."""
    for share in NEARER:
        value = changed(default, 1 + share * (factor - 1))
        given = override(FEWER, [f"{stage}.{name}={value}"])
        try:
            check_settings({stage: STAGES[stage].settings}, {stage: given[stage]})
        except UserError:
            continue
        return given
    return None


def judged(scenes: Sequence[StoredScene], settings: dict[str, dict[str, Any]]) -> Judged:
    """Decompose all scenes with these settings, and evaluate."""
    return Judged.of([one.scores(one.decomposed(settings)["albedo"]) for one in scenes])


def rows(
    scenes: Sequence[StoredScene], stage: str, usual: Judged
) -> Iterator[tuple[str, list[Change | None]]]:
    """Change each number of a stage in both directions; None where its bounds allow none."""
    for name, default in numbers_of(stage).items():
        found = []
        for factor in FACTORS:
            given = within_bounds(stage, name, default, factor)
            found.append(None if given is None else judged(scenes, given).over(usual))
        yield f"{stage}.{name}", found


def cells(change: Change | None) -> list[str]:
    """Format a change; a dash for what is not measured, since no such value is allowed."""
    return ["–"] * 3 if change is None else [f"{value:.3f}" for value in change]


def page(found: dict[str, list[Change | None]], scenes: str) -> str:
    """Format the table, largest change first, and the list of numbers without effect."""
    weight = {
        name: max((abs(np.log(one[1])) for one in both if one), default=0.0) for name, both in found.items()
    }
    order = sorted(found, key=lambda name: -weight[name])
    shown = [name for name in order if weight[name] >= 0.005]
    head = ["setting"]
    for factor in FACTORS:
        head += [f"×{factor:g}: si-RMSE", "most changed scene", "detail"]
    table = [[f"`{name}`", *(cell for one in found[name] for cell in cells(one))] for name in shown]
    fixed = [name for name in order if not any(found[name])]  # no bound allows another value
    still = [name for name in order if name not in shown and name not in fixed]
    return (
        f"{HEAD.format(scenes=scenes)}\n\n{markdown(head, table)}\n\n"
        f"Changing nothing: {listed(still)}.\n\nNot to be changed within their bounds: {listed(fixed)}.\n"
    )


def listed(names: Sequence[str]) -> str:
    """Format names of settings as a sentence's list."""
    return ", ".join(f"`{name}`" for name in names) or "none"


def main(argv: Sequence[str] | None = None) -> Path:
    """Change each number in both directions, evaluate and write; returns the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--stages", default=",".join(STAGES), help="comma-separated")
    parser.add_argument("--scenes", default=",".join(SCENES), help="comma-separated")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "sensitivity")
    parser.add_argument("--to", type=Path, default=ROOT / "workspaces" / "sensitivity")
    given = parser.parse_args(argv)
    names = given.scenes.split(",")
    scenes = [StoredScene.unpacked(name, given.workspace / name) for name in names]
    usual = judged(scenes, FEWER)
    found, written = {}, given.to / "sensitivity.md"
    for stage in given.stages.split(","):
        for name, both in rows(scenes, stage, usual):
            found[name] = both
            written.write_text(page(found, ", ".join(names)), encoding="utf-8")
    return written


if __name__ == "__main__":
    main()
