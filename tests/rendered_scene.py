"""Tiny scenes to render: a ball, a coarse bust, a job or a command with few pixels and much noise."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np

from pipeline import Job
from pipeline.cache.store import Store
from stages.cli import main
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask
from stages.formats.meshes.triangle_meshes import Surface
from stages.render import RENDER
from stages.scene.cameras import Camera
from stages.synthetic.render_settings import RenderSettings
from stages.synthetic.subjects.isosurface import closed_surface
from stages.synthetic.views import arc_of_views

TINY = {"spacing": 0.03, "views": 1, "width_px": 24, "height_px": 32, "arc_deg": 0.0, "noise": 1.0}


@cache
def ball(spacing: float = 0.06) -> Surface:
    """A ball of radius 0.5 around the origin."""
    return closed_surface(
        lambda x: np.linalg.norm(x, axis=-1) - np.float32(0.5), np.full(3, -0.61), np.full(3, 0.61), spacing
    )


def towards_origin(azimuth_deg: float, elevation_deg: float, side_px: int = 24, focal_px=60.0) -> Camera:
    """A square picture of what is at the origin, from three units away."""
    size = (side_px, side_px)
    return arc_of_views([azimuth_deg], [elevation_deg], 3.0, np.zeros(3), size, focal_px)[0]


def rendered(make_job, folder: Path, **changes) -> Job:
    """The stage itself, done: the bust, or what `object` and `environment` say; settings as in `TINY`."""
    inputs = {name: changes.pop(name) for name in ("object", "environment") if name in changes}
    job = make_job(folder, RENDER, RenderSettings(**(TINY | changes)), **inputs)
    RENDER.run(job)
    return job


def view(job: Job, what: str, name: str = "000") -> np.ndarray:
    """A map of a rendered view: `images`, `masks`, or one of the truth's folders."""
    folder = job.outputs[what] if what in job.outputs else job.outputs["truth"] / what
    if what in ("mask", "masks"):
        return read_mask(folder / f"{name}.png")
    return read_exr(folder / f"{name}.exr")


def write_config(path: Path, **sections) -> Path:
    """A configuration beside which the workspace `w` will be."""
    path.write_text(json.dumps({"workspace": "w", **sections}), encoding="utf-8")  # JSON is YAML
    return path


def unshade(capsys, *words: str | Path) -> tuple[int, str, str]:
    """Exit code, output, error output of one command."""
    code = main([str(word) for word in words])
    return code, *capsys.readouterr()


def artefact(workspace: Path, stage: str, name: str) -> Path:
    """Where a stage's current result lies."""
    store = Store(workspace)
    return store.entry(stage, store.current(stage).key) / name
