"""Scenes rendered once and stored in `tests/accuracy_scenes`, through the real program as a user has them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

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


@dataclass(frozen=True, eq=False)
class Decomposed:
    """A stored scene, its arrays by name, and the paths of what the program has made of it."""

    scene: Mapping[str, np.ndarray]
    paths: Mapping[str, Path]

    @property
    def names(self) -> list[str]:
        """Of the views."""
        return names_of(self.scene)

    def stored(self, view: str) -> dict[str, np.ndarray]:
        """Read what is stored of a view, by kind."""
        kinds = {key.removesuffix(f"_{view}"): key for key in self.scene if key.endswith(f"_{view}")}
        return {kind: self.scene[key] for kind, key in kinds.items()}

    def values(self, kind: str, view: str) -> np.ndarray:
        """Read a map of a view, (h, w, 3), float32: its stored image, or what was found (albedo, shading)."""
        if kind == "image":
            return self.scene[f"image_{view}"].astype(np.float32)
        return read_exr(self.paths[kind] / f"{view}.exr")

    def scores(self, kind: str = "albedo") -> Scores:
        """Compare maps of all views with the true albedo."""
        return score_albedo(
            [
                judge_view(
                    view,
                    self.values(kind, view),
                    self.scene[f"albedo_{view}"].astype(np.float32),
                    self.scene[f"mask_{view}"],
                )
                for view in self.names
            ]
        )


def names_of(scene: Mapping[str, np.ndarray]) -> list[str]:
    """Names of the views, sorted."""
    return sorted(key.removeprefix("image_") for key in scene if key.startswith("image_"))


def decomposed(name: str, folder: Path, settings: dict[str, dict[str, Any]]) -> Decomposed:
    """Write a stored scene as a user has it (photos, masks, a COLMAP model, a mesh), and decompose it."""
    with np.load(SCENES / f"{name}.npz") as stored:
        scene = dict(stored)
    for kind in ("images", "masks"):
        (folder / kind).mkdir()
    cameras = []
    for view in names_of(scene):
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
    done = results_of(flow, sources, settings, folder / "w", "decomposition", 2, Terminal())
    return Decomposed(scene, done.paths)
