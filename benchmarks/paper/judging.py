"""Evaluation of a row: every method on the same pixels of the same views, against the same truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.paper.laboratory import Results
from stages.evaluation.agreement import Correspondences
from stages.evaluation.judged_views import judge_view
from stages.evaluation.scores import Scores, score_albedo
from stages.formats.artefacts.camera_file import read_cameras
from stages.formats.artefacts.correspondence_files import read_correspondences
from stages.formats.artefacts.part_maps import read_part_map, read_part_names
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask

Maps = Mapping[str, np.ndarray]  # by view name, (h, w, 3), linear


@dataclass(frozen=True, eq=False)
class Judge:
    """The images of a row, its truth, and the masks in which all methods work and are evaluated."""

    names: tuple[str, ...]
    images: Maps
    masks: Mapping[str, np.ndarray]
    truth: Path
    part_names: tuple[str, ...]
    correspondences: Correspondences

    @classmethod
    def of(cls, prepared: Results) -> Judge:
        """Open the output of `Laboratory.prepare`."""
        paths = prepared.paths
        names = tuple(camera.name for camera in read_cameras(paths["cameras"]))
        masks = {name: read_mask(paths["mask"] / f"{name}.png") for name in names}
        return cls(
            names=names,
            images=maps_in(paths["linear"], names),
            masks=masks,
            truth=paths["truth"],
            part_names=read_part_names(paths["truth"] / "parts.json"),
            correspondences=Correspondences(read_correspondences(paths["correspondences"]), masks),
        )

    def scores(self, albedo: Maps) -> Scores:
        """Measure a method's albedo."""
        views = [
            judge_view(
                name,
                albedo[name],
                self.true_albedo(name),
                self.judged(name),
                read_part_map(self.truth / "parts" / f"{name}.png", len(self.part_names)),
                read_exr(self.truth / "shading" / f"{name}.exr"),
            )
            for name in self.names
        ]
        return score_albedo(views, self.part_names, self.correspondences)

    def judged(self, name: str) -> np.ndarray:
        """Select the pixels of a view for the evaluation, (h, w), bool: its mask where the truth is known."""
        return self.masks[name] & read_mask(self.truth / "mask" / f"{name}.png")

    def true_albedo(self, name: str) -> np.ndarray:
        """Read the true albedo of a view, (h, w, 3), linear."""
        return read_exr(self.truth / "albedo" / f"{name}.exr")


def maps_in(folder: Path, names: tuple[str, ...]) -> Maps:
    """Read the EXR maps of all views in a folder."""
    return {name: read_exr(folder / f"{name}.exr") for name in names}
