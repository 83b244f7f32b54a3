"""Scenes rendered once and stored (`tests/accuracy_scenes`), decomposed by the program like user input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import stages
from benchmarks.paper.laboratory import results_of
from pipeline.command.terminal import Terminal
from stages.evaluation.judged_views import judge_view
from stages.evaluation.scores import Scores, score_albedo
from stages.formats.colmap.model import pinhole_model, write_model
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import write_mask
from stages.formats.meshes.triangle_meshes import Surface, write_mesh
from stages.scene.cameras import Camera

FEWER = {"lighting": {"samples": 5000}}  # a third of the time, and hardly another light
SCENES = Path(__file__).resolve().parent.parent.parent / "tests/accuracy_scenes"


@dataclass(frozen=True, eq=False)
class StoredScene:
    """A stored scene, and a folder with its files as a user provides them: photos, masks, COLMAP model, mesh.

    Attributes
    ----------
    arrays : mapping of str to ndarray
        Stored arrays, by kind and view.
    folder : Path
    """

    arrays: Mapping[str, np.ndarray]
    folder: Path

    @classmethod
    def unpacked(cls, name: str, folder: Path) -> StoredScene:
        """Unpack the scene of this name into a folder."""
        with np.load(SCENES / f"{name}.npz", allow_pickle=False) as stored:
            scene = cls(dict(stored), folder)
        for kind in ("images", "masks"):
            (folder / kind).mkdir(parents=True, exist_ok=True)
        cameras = []
        for view in scene.names:
            own = scene.of_view(view)
            write_exr(folder / f"images/{view}.exr", own["image"].astype(np.float32))
            write_mask(folder / f"masks/{view}.png", own["mask"])
            height, width = own["mask"].shape
            cameras.append(Camera(view, width, height, own["intrinsics"], own["cam_from_world"]))
        write_model(pinhole_model(cameras, extension=".exr"), folder / "model")
        vertices, faces = scene.arrays["vertices"].astype(np.float64), scene.arrays["faces"]
        write_mesh(folder / "mesh.ply", Surface(vertices, faces))
        return scene

    @property
    def names(self) -> list[str]:
        """Names of the views, sorted."""
        return sorted(key.removeprefix("image_") for key in self.arrays if key.startswith("image_"))

    def of_view(self, view: str) -> dict[str, np.ndarray]:
        """Select the stored arrays of a view, by kind."""
        kinds = {key.removesuffix(f"_{view}"): key for key in self.arrays if key.endswith(f"_{view}")}
        return {kind: self.arrays[key] for kind, key in kinds.items()}

    def photos(self) -> dict[str, np.ndarray]:
        """Linear photos by view, (h, w, 3), float32."""
        return {view: self.of_view(view)["image"].astype(np.float32) for view in self.names}

    def decomposed(self, settings: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, np.ndarray]]:
        """Decompose the scene; returns albedo and shading of each view by its name, (h, w, 3), float32."""
        sources = {
            "images": self.folder / "images",
            "masks": self.folder / "masks",
            "colmap": self.folder / "model",
            "mesh_file": self.folder / "mesh.ply",
        }
        flow, workspace = stages.dataflow(sources), self.folder / "workspace"
        done = results_of(flow, sources, settings, workspace, "decomposition", 2, Terminal())
        return {
            kind: {view: read_exr(done.paths[kind] / f"{view}.exr") for view in self.names}
            for kind in ("albedo", "shading")
        }

    def scores(self, albedo: Mapping[str, np.ndarray]) -> Scores:
        """Compare the albedo of all views with the truth."""
        truths = {view: self.of_view(view) for view in self.names}
        return score_albedo(
            [
                judge_view(view, albedo[view], truth["albedo"].astype(np.float32), truth["mask"])
                for view, truth in truths.items()
            ]
        )
