"""A problem for the solvers, opened from artefacts of the dataflow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stages.formats.artefacts.camera_file import read_cameras
from stages.formats.artefacts.correspondence_files import numbered_correspondences
from stages.formats.artefacts.view_files import read_views, scaled_channels
from stages.photometry.paper.energy import EnergyWeights
from stages.photometry.stack import StackedViews, stack_views


@dataclass(frozen=True, eq=False)
class RaceProblem:
    """Eq. 2, ready to be minimised.

    Attributes
    ----------
    name : str
        Also of its files.
    about : str
        One phrase.
    views : StackedViews
    images : list of 3 ndarray, shape (N,), float32
        Scaled: 99th percentile = 1.
    weights : EnergyWeights
    """

    name: str
    about: str
    views: StackedViews
    images: list[np.ndarray]
    weights: EnergyWeights

    @property
    def pixels(self) -> int:
        """Number of pixels N."""
        return int(self.views.starts[-1])

    def fresh_views(self) -> StackedViews:
        """Copy the views without values cached by an earlier method, so that each computes its own."""
        return replace(self.views)


def views_and_images(paths: Mapping[str, Path]) -> tuple[StackedViews, list[np.ndarray]]:
    """Open the inputs of the `decomposition` stage from artefacts by name."""
    cameras = read_cameras(paths["cameras"])
    masks, normals, linear = zip(*read_views(paths, cameras), strict=True)
    views = stack_views(masks, normals, numbered_correspondences(paths["correspondences"], cameras))
    return views, scaled_channels(np.concatenate(linear))[0]
