"""The albedos of one scene under two lights: ``python -m benchmarks.accuracy.two_lights``.

Shading left in the albedo differs between the two; the true albedo does not. Natural scenes of exact
geometry; those of `benchmarks.accuracy --natural` are rendered and decomposed once for both. All six need
``UNSHADE_DATA``.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

import numpy as np  # noqa: E402

from benchmarks.accuracy.natural import NATURAL_SCENES, at_hand, natural_row  # noqa: E402
from benchmarks.accuracy.scenes import SCAN_SIZE, laboratory_of  # noqa: E402
from benchmarks.paper.judging import maps_in  # noqa: E402
from benchmarks.paper.laboratory import TINY, Size  # noqa: E402
from benchmarks.paper.rows import Row  # noqa: E402
from benchmarks.paper.tables import markdown  # noqa: E402
from stages.evaluation.agreement import relative_difference  # noqa: E402
from stages.formats.artefacts.camera_file import read_cameras  # noqa: E402
from stages.formats.images.contact_sheet import contact_sheet  # noqa: E402
from stages.formats.images.photos import encode_srgb8, read_mask, write_png8  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent
OTHER_LIGHTS = (  # for the scenes of that number among `NATURAL_SCENES`
    (0, "venice"),
    (1, "sun_and_sky"),
    (2, "park"),
    (3, "studio"),
    (4, "city"),
    (6, "workshop"),
)
HEAD = """# One scene under two lights

Written by `python -m benchmarks.accuracy.two_lights`. By how much the pixels of all views differ from the one
light to the other, RMS after one scale per channel, over the mean: the photos, and the albedos of them. 0 is
best; noise of the renders, two percent, is in both."""
WHITE = 0.99  # quantile that is shown white


@dataclass(frozen=True, eq=False)
class Pair:
    """A scene, its lights, the differences of photos and albedos (red, green, blue), and one view of each."""

    name: str
    about: str
    photos: tuple[float, ...]
    albedos: tuple[float, ...]
    picture: np.ndarray

    @property
    def ratio(self) -> float:
        """Remaining share of the photos' difference, mean of the channels."""
        return float(np.mean(self.albedos) / np.mean(self.photos))


def main(argv: Sequence[str] | None = None) -> Path:
    """Render, decompose, compare and write; returns the page."""
    given = arguments(argv)
    data = Path(os.environ["UNSHADE_DATA"]) if "UNSHADE_DATA" in os.environ and not given.tiny else None
    given.to.mkdir(parents=True, exist_ok=True)
    size, compared = TINY if given.tiny else SCAN_SIZE, []
    for rows in pairs(data):
        compared.append(compare(rows, size, given.workspace))
        write_png8(given.to / f"{compared[-1].name}.png", compared[-1].picture)
        page = given.to / "two_lights.md"
        page.write_text(page_of(compared), encoding="utf-8")
    return page


def pairs(data: Path | None) -> list[tuple[Row, Row]]:
    """Make the rows; without the data folder only those of our own subjects and lights."""
    told = []
    for number, other in OTHER_LIGHTS:
        subject, light, *_ = NATURAL_SCENES[number]
        if at_hand(data, subject, light) and at_hand(data, subject, other):
            told.append((_under(data, number, light), _under(data, number, other)))
    return told


def _under(data: Path | None, number: int, light: str) -> Row:
    """Build the row of a scene under a light."""
    subject, _, *rest = NATURAL_SCENES[number]
    return natural_row(data, subject, light, *rest)


def compare(rows: tuple[Row, Row], size: Size, workspace: Path) -> Pair:
    """Decompose both, and compare the albedos inside the masks of all views."""
    done = [laboratory_of(row, size, workspace).run_with(row, {"mode": "transfer"}).paths for row in rows]
    names = tuple(camera.name for camera in read_cameras(done[0]["cameras"]))
    masks = {name: read_mask(done[0]["mask"] / f"{name}.png") for name in names}
    photos, albedos = ([maps_in(paths[kind], names) for paths in done] for kind in ("linear", "albedo"))

    def differ(maps: list[dict[str, np.ndarray]]) -> tuple[float, ...]:
        return relative_difference(*(np.concatenate([one[n][masks[n]] for n in names]) for one in maps))

    middle = names[len(names) // 2]
    shown = [_picture(one[middle], masks[middle]) for one in (*photos, *albedos)]
    other = rows[1].render["light"]
    light = Path(rows[1].sources["environment"]).stem if other == "environment" else other
    heads = ["photo", f"photo, {light}", "albedo", f"albedo, {light}"]
    picture = contact_sheet({middle: shown}, heads, 220)
    name, about = f"{rows[0].name}-or-{light}", f"{rows[0].about}, or {light.replace('_', ' ')}"
    return Pair(name, about, differ(photos), differ(albedos), picture)


def _picture(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return encode_srgb8(image / np.quantile(image[mask], WHITE) * mask[..., None])


def page_of(compared: Sequence[Pair]) -> str:
    """Format the table and pictures."""
    table: list[list[Any]] = [
        [one.about, *(" ".join(f"{v:.2f}" for v in each) for each in (one.photos, one.albedos))]
        + [f"{one.ratio:.3f}"]
        for one in compared
    ]
    head = ["scene", "photos (red green blue)", "albedos", "albedos / photos"]
    pictures = [f"![{one.about}]({one.name}.png)" for one in compared]
    return "\n\n".join([HEAD, markdown(head, table), *pictures]) + "\n"


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--tiny", action="store_true", help="our own pair, too small to mean much")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "accuracy")
    parser.add_argument("--to", type=Path, default=ROOT / "workspaces" / "accuracy" / "report")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
