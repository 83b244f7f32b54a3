"""Views under a new light, against path-traced truth: ``python -m benchmarks.accuracy.relighting``.

A scene is decomposed in its own light, and `relight` shows it under another: from the albedo, and, as a
baseline, from the photos used as albedo (the photo-textured model). The truth is the same scene rendered
under the other light. Needs ``UNSHADE_DATA``, whose environment maps are the other lights.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

import numpy as np  # noqa: E402

from benchmarks.accuracy.scenes import laboratory_of, paper_rows, scan_rows  # noqa: E402
from benchmarks.paper.judging import Maps, maps_in  # noqa: E402
from benchmarks.paper.laboratory import Size  # noqa: E402
from benchmarks.paper.rows import Row  # noqa: E402
from benchmarks.paper.tables import markdown  # noqa: E402
from pipeline import Job  # noqa: E402
from pipeline.command.terminal import Terminal  # noqa: E402
from stages.evaluation.judged_views import judge_view  # noqa: E402
from stages.evaluation.scaled_error import psnr_h  # noqa: E402
from stages.formats.artefacts.camera_file import read_cameras  # noqa: E402
from stages.formats.images.contact_sheet import contact_sheet  # noqa: E402
from stages.formats.images.photos import encode_srgb8, read_mask, write_png8  # noqa: E402
from stages.relight import RELIGHT, RelightSettings  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent
OTHER_LIGHT = {  # of a row, a picture of light that it does not stand in
    "fig3": "city",
    "fig4": "park",
    "fig5": "workshop",
    "gutenberg-dome-parts": "venice",
    "plato-one_lamp-texture": "apartment",
    "skull-workshop-stripes": "studio",
}
HEAD = """# Relit, against path-traced truth

Written by `python -m benchmarks.accuracy.relighting`. PSNR of the masked views, one scale per channel for all
of them; the empty part of the frame counts as correct: differences mean something, levels little."""
WHITE = 0.99  # quantile of the true radiance that PSNR takes for 1


@dataclass(frozen=True, eq=False)
class Relit:
    """A row under another light: PSNR, dB, from the photos and from the albedo; and one view of each."""

    name: str
    light: str
    from_photos: float
    from_albedo: float
    picture: np.ndarray


def main(argv: Sequence[str] | None = None) -> Path:
    """Decompose, relight, render, evaluate and write; returns the page."""
    given = arguments(argv)
    if "UNSHADE_DATA" not in os.environ:
        raise SystemExit("UNSHADE_DATA is not set; expected the folder that holds hdri-polyhaven-1k.")
    if unknown := [name for name in given.rows.split(",") if name not in OTHER_LIGHT]:
        raise SystemExit(f"--rows {', '.join(unknown)}: expected names among {', '.join(OTHER_LIGHT)}.")
    data = Path(os.environ["UNSHADE_DATA"])
    rows = {row.name: (row, size) for row, size in (*paper_rows(), *scan_rows(data))}
    given.to.mkdir(parents=True, exist_ok=True)
    judged = []
    for name in given.rows.split(","):
        light = data / f"hdri-polyhaven-1k/{OTHER_LIGHT[name]}.hdr"
        judged.append(in_another_light(*rows[name], light, given.workspace))
        write_png8(given.to / f"{name}-relit.png", judged[-1].picture)
        page = given.to / "relighting.md"
        page.write_text(page_of(judged), encoding="utf-8")
    return page


def in_another_light(row: Row, size: Size, light: Path, workspace: Path) -> Relit:
    """Relight a row in both ways, and compare with the truth."""
    laboratory = laboratory_of(row, size, workspace)
    done = laboratory.run_with(row, {"mode": "transfer"}).paths
    elsewhere = replace(
        row,
        name=f"{row.name}-in-{light.stem}",
        render={**row.render, "light": "environment"},
        sources={**row.sources, "environment": light},
    )
    truth = laboratory.prepare(elsewhere).paths
    names = tuple(camera.name for camera in read_cameras(done["cameras"]))
    masks = {name: read_mask(done["mask"] / f"{name}.png") for name in names}
    true = maps_in(truth["linear"], names)
    white = np.quantile(np.concatenate([true[name][masks[name]] for name in names]), WHITE)
    true = {name: image / white for name, image in true.items()}
    from_photos, from_albedo = (relit(done, done[kind], light, names) for kind in ("linear", "albedo"))
    decibels = [_psnr(maps, true, masks) for maps in (from_photos, from_albedo)]
    middle = names[len(names) // 2]
    photo = maps_in(done["linear"], (middle,))[middle]
    shown = [_fitted(maps[middle], true[middle], masks[middle]) for maps in (from_photos, from_albedo)]
    columns = [photo / np.quantile(photo[masks[middle]], WHITE), true[middle], *shown]
    pictures = [encode_srgb8(one * masks[middle][..., None]) for one in columns]
    heads = ["photo", f"truth, {light.stem}", "relit from photo", "relit from albedo"]
    return Relit(row.name, light.stem, *decibels, contact_sheet({middle: pictures}, heads, 220))


def relit(paths: Mapping[str, Path], albedo: Path, light: Path, names: Sequence[str]) -> Maps:
    """Relight albedo maps by the `relight` stage."""
    terminal = Terminal()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:
        job = Job(
            settings=RelightSettings(),
            inputs={**paths, "albedo": albedo, "light": light},
            outputs={"relit": Path(folder), "surface_light": Path(folder) / "surface_light.npz"},
            scratch=Path(folder),
            threads=len(os.sched_getaffinity(0)),
            executor=executor,
            shown=terminal,
            say=terminal.say,
        )
        RELIGHT.run(job)
        return maps_in(Path(folder), tuple(names))


def _psnr(maps: Maps, true: Maps, masks: Mapping[str, np.ndarray]) -> float:
    """Compute the mean PSNR over the views, with one scale per channel for all views."""
    views = [judge_view(name, maps[name], image, masks[name]) for name, image in true.items()]
    return float(np.mean(list(psnr_h(views).values())))


def _fitted(image: np.ndarray, true: np.ndarray, mask: np.ndarray) -> np.ndarray:
    inside, truth = image[mask], true[mask]
    return image * ((inside * truth).sum(axis=0) / np.maximum((inside * inside).sum(axis=0), 1e-12))


def page_of(judged: Sequence[Relit]) -> str:
    """Format the table and pictures."""
    table = [
        [one.name, one.light, f"{one.from_photos:.1f}", f"{one.from_albedo:.1f}", f"{gain:+.1f}"]
        for one in judged
        for gain in [one.from_albedo - one.from_photos]
    ]
    head = ["scene", "other light", "from the photos, dB", "from the albedo, dB", "gain, dB"]
    pictures = [f"![{one.name}]({one.name}-relit.png)" for one in judged]
    return "\n\n".join([HEAD, markdown(head, table), *pictures]) + "\n"


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--rows", default=",".join(OTHER_LIGHT), help="comma-separated; all by default")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "accuracy")
    parser.add_argument("--to", type=Path, default=ROOT / "workspaces" / "accuracy" / "report")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
