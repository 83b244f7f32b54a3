"""Rows whose poses and shape are estimated: 8-bit photos of a rendered scene through the whole pipeline."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import stages
from benchmarks.paper.laboratory import Laboratory, Results, results_of
from benchmarks.paper.rows import Row
from pipeline.config import check_settings
from stages.additions import as_asked_for
from stages.formats.colmap.model import cameras_of, read_model
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask, write_png_srgb8
from stages.synthetic.sample import exposure


class PhotoLaboratory(Laboratory):
    """A laboratory that renders, writes 8-bit photos, and starts from these.

    The lens is known and held, as of a calibrated camera, so that photos are not resampled and the true
    albedo has their pixels. Poses, depth and mesh are estimated. The masks of the render are given.
    """

    def _run(
        self,
        row: Row,
        decomposition: dict[str, Any],
        lighting: dict[str, Any],
        last: str,
        correspondence: dict[str, Any] | None = None,
    ) -> Results:
        rendered = results_of(
            stages.experiment(row.sources),
            row.sources,
            self.given(row, {}),
            self.workspace,
            "render",
            self.threads,
            self.listener,
        )
        photos = develop(rendered.paths, self.workspace / "photos")
        camera = cameras_of(read_model(rendered.paths["model"]))[0]
        K = camera.intrinsics
        given = {
            "sfm": {
                "camera_model": "PINHOLE",
                "camera_params": [float(v) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2])],
                "free_principal_point": False,
            },
            "undistort": {"max_size_px": None},
            "correspondence": correspondence or {},
            "lighting": lighting,
            "decomposition": decomposition,
        }
        sources = {"images": photos, "masks": rendered.paths["masks"]}
        settings = check_settings({stage.name: stage.settings for stage in stages.ALL_STAGES}, given)
        flow = as_asked_for(stages.dataflow(sources, stages.kind_of_light(settings, sources)), settings)
        done = results_of(
            flow, sources, given, self.workspace / "estimated", last, self.threads, self.listener
        )
        return Results({**rendered.paths, **done.paths}, {**rendered.facts, **done.facts})


def develop(rendered: dict[str, Path], folder: Path) -> Path:
    """Write 8-bit sRGB photos of a render, with one exposure; the same bytes for the same render."""
    images = {path.stem: read_exr(path) for path in sorted(rendered["images"].glob("*.exr"))}
    masks = [read_mask(rendered["masks"] / f"{name}.png") for name in images]
    white = exposure(list(images.values()), masks)
    folder.mkdir(parents=True, exist_ok=True)
    for name, image in images.items():
        write_png_srgb8(folder / f"{name}.png", image * white)
    (folder.parent / "exposure.json").write_text(json.dumps({"factor": white}), encoding="utf-8")
    return folder
