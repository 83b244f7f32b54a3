"""Prediction and truth of a view on the pixels where both are valid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline import UserError
from stages.scene.albedo_floor import ALBEDO_FLOOR

CHANNELS = ("red", "green", "blue")


@dataclass(frozen=True, eq=False)
class JudgedView:
    """One view; all maps are 0 at pixels that are not judged. Made by `judge_view`.

    Attributes
    ----------
    name : str
        View name, by which prediction and truth are matched.
    prediction, truth : ndarray, shape (h, w, 3), float32 or float64
        Linear albedo, finite.
    judged : ndarray, shape (h, w), bool
        Pixels that are evaluated.
    parts : ndarray, shape (h, w), uint8
        k where the k-th part of uniform albedo is, from 1; 0 elsewhere (seams, textured parts, background).
    shading : ndarray, shape (h, w, 3), float32 or float64
        True shading, linear: image divided by true albedo; 0 where it is unknown.
    """

    name: str
    prediction: np.ndarray
    truth: np.ndarray
    judged: np.ndarray
    parts: np.ndarray
    shading: np.ndarray


def judge_view(
    name: str,
    prediction: np.ndarray,
    truth: np.ndarray,
    judged: np.ndarray,
    parts: np.ndarray | None = None,
    shading: np.ndarray | None = None,
) -> JudgedView:
    """Check a view's maps and clear unjudged pixels; shapes and meanings as in `JudgedView`.

    Raises
    ------
    UserError
        Sizes differ, or a judged value is not a finite number.
    """
    shape = truth.shape[:2]
    parts = np.zeros(shape, np.uint8) if parts is None else parts
    shading = np.zeros((*shape, 3), np.float32) if shading is None else shading
    maps = {"prediction": prediction, "mask": judged, "map of parts": parts, "true shading": shading}
    for what, array in maps.items():
        check_size(name, what, array, truth)
    for what, array in {"prediction": prediction, "true albedo": truth, "true shading": shading}.items():
        bad = int(np.count_nonzero(~np.isfinite(array[judged])))
        if bad:
            raise UserError(
                f"View {name}: {bad} judged values of the {what} are not finite numbers; expected linear "
                "albedo. Repair them, or mask these pixels out."
            )
    inside = judged[..., None]
    return JudgedView(
        name,
        np.where(inside, prediction, np.float32(0)),
        np.where(inside, truth, np.float32(0)),
        judged,
        np.where(judged, parts, np.uint8(0)),
        np.where(inside, shading, np.float32(0)),
    )


def check_size(name: str, what: str, array: np.ndarray, truth: np.ndarray) -> None:
    """Check that a map of a view, shape (h, w[, 3]), has the size of the true albedo.

    Raises
    ------
    UserError
        It does not.
    """
    (height, width), (true_height, true_width) = array.shape[:2], truth.shape[:2]
    if (height, width) != (true_height, true_width):
        raise UserError(
            f"View {name}: the {what} has {width} × {height} pixels, the true albedo {true_width} × "
            f"{true_height}; expected the same size. Decompose at the truth's size "
            "(undistort.max_size_px=none, raycast.reduce=1, and cameras without distortion by --colmap: "
            "undistortion crops), or render the truth at the prediction's."
        )


def channel_values(views: Sequence[JudgedView], channel: int) -> tuple[np.ndarray, np.ndarray]:
    """Collect prediction and truth of one channel on the judged pixels of all views, (N,), float64."""
    prediction = np.concatenate([view.prediction[view.judged, channel] for view in views])
    truth = np.concatenate([view.truth[view.judged, channel] for view in views])
    return prediction.astype(np.float64), truth.astype(np.float64)


def part_values(views: Sequence[JudgedView], part: int, channel: int) -> tuple[np.ndarray, ...]:
    """Collect prediction, truth and shading of one channel in one part of all views, (N,), float64.

    Parameters
    ----------
    part : int
        Number of the part in the maps, from 1.
    """
    inside = [view.parts == part for view in views]
    return tuple(
        np.concatenate([maps[k][..., channel][inside[k]] for k in range(len(views))]).astype(np.float64)
        for maps in (
            [view.prediction for view in views],
            [view.truth for view in views],
            [view.shading for view in views],
        )
    )


def true_value(part: str, channel: str, truth: np.ndarray) -> float:
    """Compute the albedo of a uniform part from its pixels, shape (N,), as their median.

    Raises
    ------
    UserError
        The albedo is not uniform: the part's map includes seams or texture, where variance means nothing.
    """
    value = float(np.median(truth))
    spread = float(np.abs(truth - value).max())
    if spread > 0.01 * max(value, ALBEDO_FLOOR):
        raise UserError(
            f"The true {channel} albedo of the part {part!r} is not uniform: it departs by {spread:.4f} from "
            f"{value:.4f}. Expected one value; leave pixels on seams and textured parts out of parts/."
        )
    return value


def above_floor(true_albedo: float) -> bool:
    """Check that a true albedo is large enough to be compared; in float32, as it was stored."""
    return bool(np.float32(true_albedo) >= np.float32(ALBEDO_FLOOR))
