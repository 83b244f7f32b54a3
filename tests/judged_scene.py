"""A scene to judge, made of numbers alone: three uniform parts, a seam, smooth shading, known everywhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stages.evaluation.judged_views import JudgedView, judge_view
from stages.formats.images.exr import write_exr
from stages.formats.images.photos import write_mask, write_png8

PARTS = ("hair", "face", "shirt")
ALBEDO = np.array([[1, 0.0314, 0], [1, 0.5333, 0.3608], [0.0196, 0.0549, 1]], np.float32)
NAMES = ("a/früh am morgen", "b.2")  # sub-folder, space, non-ASCII, a dot within
SHAPES = ((40, 60), (50, 41))  # views differ in size


def truth_view(index: int, prediction: np.ndarray | None = None) -> JudgedView:
    """One of the two views, the truth judged against itself unless a prediction is given."""
    height, width = SHAPES[index]
    parts = np.zeros((height, width), np.uint8)
    for k in range(3):
        parts[2:-2, 2 + k * 12 : 13 + k * 12] = k + 1  # a column between two parts is a seam, part 0
    judged = np.zeros((height, width), bool)
    judged[2:-2, 2:37] = True
    truth = np.zeros((height, width, 3), np.float32)
    for k in range(3):
        truth[parts == k + 1] = ALBEDO[k]
    truth[judged & (parts == 0)] = 0.4
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    light = (1.2 + 0.7 * x + 0.3 * y * (index + 1)).astype(np.float32)
    shading = np.repeat(light[..., None], 3, axis=-1)
    shading[~judged] = 0
    return judge_view(
        NAMES[index], truth if prediction is None else prediction, truth, judged, parts, shading
    )


def truth_views() -> list[JudgedView]:
    """Both views, the truth judged against itself."""
    return [truth_view(0), truth_view(1)]


def predicted(change) -> list[JudgedView]:
    """Both views with ``change(view, index)`` as the prediction, an array (h, w, 3)."""
    return [truth_view(i, change(truth_view(i), i).astype(np.float32)) for i in range(2)]


def write_truth(folder: Path) -> Path:
    """Both views as a folder of truth on disk."""
    for view in truth_views():
        write_exr(folder / "albedo" / f"{view.name}.exr", view.truth)
        write_exr(folder / "shading" / f"{view.name}.exr", view.shading)
        write_mask(folder / "mask" / f"{view.name}.png", view.judged)
        write_png8(folder / "parts" / f"{view.name}.png", view.parts)
    (folder / "parts.json").write_text('{"parts": ["hair", "face", "shirt"]}', encoding="utf-8")
    return folder
