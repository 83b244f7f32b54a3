"""Accuracy held: three stored renders through the real program, from linear photos to albedo.

Figures are those of the day they were written down; a method may better them and then says so here. What
makes one of them worse by an eighth is a regression, even if nothing else fails. The scenes are rendered by
`tests/accuracy_scenes/make.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import stages
from benchmarks.paper.laboratory import results_of
from pipeline.terminal import Terminal
from stages.evaluation.judged_views import judge_view
from stages.evaluation.scores import Scores, score_albedo
from stages.formats.colmap.model import pinhole_model, write_model
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import write_mask
from stages.formats.meshes.triangle_meshes import Surface, write_mesh
from stages.scene.cameras import Camera

SCENES = Path(__file__).parent / "accuracy_scenes"
WORSE = 1.125
FEWER = {"lighting": {"samples": 5000}}  # a third of the time, and hardly another light


@dataclass(frozen=True)
class Held:
    """Mean si-RMSE of the channels, and of the five octaves error and gain of log brightness."""

    si_rmse: float
    error: tuple[float, ...]
    gain: tuple[float, ...]


HELD = {
    "relief": Held(0.0511, (0.402, 0.363, 0.332, 0.517, 0.567), (0.788, 0.829, 0.935, 0.884, 0.592)),
    "bust": Held(0.0324, (0.618, 0.599, 0.400, 0.348, 0.588), (0.655, 0.782, 1.001, 0.951, 0.986)),
    "courtyard": Held(0.0491, (0.415, 0.488, 0.942, 1.641, 2.453), (0.882, 0.826, 0.621, 0.802, 1.025)),
}


def scores_of(name: str, folder: Path) -> Scores:
    """Write a stored scene as a user has it, decompose it, and judge."""
    with np.load(SCENES / f"{name}.npz") as stored:
        scene = dict(stored)
    names = sorted(key.removeprefix("image_") for key in scene if key.startswith("image_"))
    for kind in ("images", "masks"):
        (folder / kind).mkdir()
    cameras = []
    for view in names:
        image, mask = scene[f"image_{view}"].astype(np.float32), scene[f"mask_{view}"]
        write_exr(folder / f"images/{view}.exr", image)
        write_mask(folder / f"masks/{view}.png", mask)
        K, pose = scene[f"intrinsics_{view}"], scene[f"cam_from_world_{view}"]
        cameras.append(Camera(view, mask.shape[1], mask.shape[0], K, pose))
    write_model(pinhole_model(cameras, extension=".exr"), folder / "model")
    write_mesh(folder / "mesh.ply", Surface(scene["vertices"].astype(np.float64), scene["faces"]))
    sources = {
        "images": folder / "images",
        "masks": folder / "masks",
        "colmap": folder / "model",
        "mesh_file": folder / "mesh.ply",
    }
    flow = stages.dataflow(sources)
    done = results_of(flow, sources, FEWER, folder / "w", "decomposition", 2, Terminal())
    views = [
        judge_view(
            view,
            read_exr(done.paths["albedo"] / f"{view}.exr"),
            scene[f"albedo_{view}"].astype(np.float32),
            scene[f"mask_{view}"],
        )
        for view in names
    ]
    return score_albedo(views)


@pytest.mark.parametrize("name", HELD)
def test_no_figure_has_become_worse_by_an_eighth(name, tmp_path):
    scores, held = scores_of(name, tmp_path), HELD[name]
    found = Held(
        round(float(np.mean(scores.si_rmse)), 4),
        tuple(round(float(octave.brightness_error), 3) for octave in scores.detail),
        tuple(round(float(octave.brightness_gain), 3) for octave in scores.detail),
    )
    assert found.si_rmse <= WORSE * held.si_rmse, found
    assert np.all(np.array(found.error) <= WORSE * np.array(held.error)), found
    assert np.all(np.array(found.gain) >= np.array(held.gain) - 0.06), found
