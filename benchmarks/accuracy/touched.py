"""The few settings that users change, in pictures: ``python -m benchmarks.accuracy.touched``.

Each is shown on a row of the paper where it has an effect, at some values, the default among them; all
others have their defaults. Writes ``touched.md`` and a picture of each.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

from benchmarks.accuracy.methods import JudgedRow, Method, judge_row  # noqa: E402
from benchmarks.accuracy.scenes import laboratory_of, paper_rows  # noqa: E402
from benchmarks.paper.laboratory import QUARTER, TINY  # noqa: E402
from benchmarks.paper.tables import markdown  # noqa: E402
from stages.formats.images.photos import write_png8  # noqa: E402
from stages.photometry.decomposition_settings import DecompositionSettings  # noqa: E402
from stages.photometry.lighting.settings import LightingSettings  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent
OF_STAGE = {"lighting": LightingSettings(), "decomposition": DecompositionSettings()}
HEAD = """# Settings that one may touch, in pictures

Written by `python -m benchmarks.accuracy.touched`. Nothing needs tuning: the defaults are the same on all
scenes. Where a result has what you do not want, these are the ones to try, one at a time
(`unshade run CONFIG --set decomposition.edges.coarse_lambda=3`: nothing before the decomposition is run
again, and the light is not sought anew).
Every picture: one view's photo, its true albedo, and what is found with the setting at some values, all else
at its default; the table has the si-RMSE of all views. What every setting means: docs/settings.md."""


@dataclass(frozen=True)
class Touched:
    """A setting of a stage or a phase, values besides the default, the row that shows them, their effect."""

    stage: str
    setting: str
    others: tuple[Any, ...]
    row: str
    says: str

    @property
    def default(self) -> Any:
        """Default value."""
        found: Any = OF_STAGE[self.stage]
        for part in (*self.phases, self.name):
            found = getattr(found, part)
        return found

    @property
    def phases(self) -> list[str]:
        """Phases that contain the setting, the outermost first."""
        return self.setting.split(".")[:-1]

    @property
    def name(self) -> str:
        """Name within its phase."""
        return self.setting.split(".")[-1]

    @property
    def values(self) -> tuple[Any, ...]:
        """All values shown, in order."""
        return tuple(sorted({*self.others, self.default}))

    def method(self, value: Any) -> Method:
        """Build the method `mode: transfer` with one of the values."""
        own: dict[str, dict[str, Any]] = {"decomposition": {"mode": "transfer"}, "lighting": {}}
        section = own[self.stage]
        for phase in self.phases:
            section = section.setdefault(phase, {})
        section[self.name] = value
        return Method(f"{self.name} {value}", own["decomposition"], lighting=own["lighting"])


TOUCHED = (
    Touched(
        "decomposition",
        "edges.coarse_lambda",
        (1.0, 40.0),
        "fig7",
        "What a change of albedo costs where the shading changes and the colour does not. More, where rims "
        "of shadows and creases are left in the albedo, as when the geometry is rough; less, where paint "
        "that changes softly comes out flat, in plates.",
    ),
    Touched(
        "decomposition",
        "edges.fine_lambda",
        (0.02, 1.0),
        "fig5",
        "What it costs elsewhere. More, where photos are noisy: lines and spots of a few pixels go as well.",
    ),
    Touched(
        "lighting",
        "specular.remove",
        (False,),
        "fig6",
        "Whether the light's image in glossy surface is looked for, and taken off. Off, the light is found "
        "sooner, and gloss is paint.",
    ),
    Touched(
        "lighting",
        "bounces",
        (0, 1),
        "fig3",
        "How often light is passed on between surfaces. With none, hollows (the mouth, the neck) are too "
        "bright, and have the colour of what is around them, twice.",
    ),
)

SETTINGS = tuple(touched.name for touched in TOUCHED)


def main(argv: Sequence[str] | None = None) -> Path:
    """Render, decompose, evaluate and write; returns the page."""
    given = arguments(argv)
    rows = {row.name: (row, size) for row, size in paper_rows(TINY if given.tiny else QUARTER)}
    given.to.mkdir(parents=True, exist_ok=True)
    sections = [HEAD]
    for touched in (one for one in TOUCHED if one.name in given.settings):
        row, size = rows[touched.row]
        methods = tuple(touched.method(value) for value in touched.values)
        judged = judge_row(laboratory_of(row, size, given.workspace), row, methods)
        write_png8(given.to / f"touched-{touched.name}.png", judged.picture)
        sections.append(section_of(touched, judged))
    page = given.to / "touched.md"
    page.write_text("\n\n".join(sections) + "\n", encoding="utf-8")
    return page


def section_of(touched: Touched, judged: JudgedRow) -> str:
    """Format the effect of the setting, the error of each value, and the picture."""
    table = [
        [
            f"{value}" + " (default)" * (value == touched.default),
            *(f"{error:.3f}" for error in one.scores.si_rmse),
        ]
        for value, one in zip(touched.values, judged.judged, strict=True)
    ]
    return "\n\n".join(
        [
            f"## `{touched.stage}.{touched.setting}`",
            f"{touched.says} Here: {judged.name}, {judged.about}.",
            markdown([touched.name, "red", "green", "blue"], table),
            f"![{judged.name} with {touched.name} at {', '.join(map(str, touched.values))}]"
            f"(touched-{touched.name}.png)",
        ]
    )


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--settings", nargs="+", choices=SETTINGS, default=SETTINGS, help="all by default")
    parser.add_argument("--tiny", action="store_true", help="too small to mean much, to show that it works")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "accuracy")
    parser.add_argument("--to", type=Path, default=ROOT / "workspaces" / "accuracy" / "report")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
