"""Leak of shading into the albedo: the slope of log albedo on log shading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.evaluation.judged_views import CHANNELS, JudgedView, above_floor, part_values, true_value
from stages.scene.albedo_floor import ALBEDO_FLOOR


@dataclass(frozen=True)
class PartLeak:
    """The leak in one part and channel.

    Attributes
    ----------
    part, channel : str
    slope : float
        0: none of the shading is in the albedo, 1: all of it; nan for the reason in `remark`.
    pixels, left_out : int
        Pixels used, and those excluded because albedo or shading is ≤ 0.
    log_shading_variance : float
        Variance of log S over the pixels used: the larger, the more certain the slope.
    remark : str
    """

    part: str
    channel: str
    slope: float
    pixels: int
    left_out: int
    log_shading_variance: float
    remark: str = ""


def part_leaks(views: Sequence[JudgedView], part_names: Sequence[str]) -> tuple[PartLeak, ...]:
    """Regress log ρ on log S_true, per part and channel, all views together; the leak is the slope.

    ``Σ (x − x̄)(y − ȳ) / Σ (x − x̄)²`` with x = log S and y = log ρ over the part's pixels. Scaling ρ or S
    changes nothing. Noise in S lowers the slope (attenuation by errors in the abscissa).

    Raises
    ------
    UserError
        A part is not uniform in the truth.
    """
    return tuple(
        _leak(part, channel, *part_values(views, number, k))
        for number, part in enumerate(part_names, 1)
        for k, channel in enumerate(CHANNELS)
    )


def channel_leaks(leaks: Sequence[PartLeak]) -> tuple[float, ...]:
    """Pool one slope per channel from all its parts, each centred on its own means; nan without any."""
    slopes = []
    for channel in CHANNELS:
        known = [leak for leak in leaks if leak.channel == channel and np.isfinite(leak.slope)]
        weights = np.array([leak.pixels * leak.log_shading_variance for leak in known])
        pooled = sum(leak.slope * weight for leak, weight in zip(known, weights, strict=True))
        slopes.append(float(pooled / weights.sum()) if known else float("nan"))
    return tuple(slopes)


def _leak(
    part: str, channel: str, prediction: np.ndarray, truth: np.ndarray, shading: np.ndarray
) -> PartLeak:
    nan = float("nan")
    if not truth.size:
        return PartLeak(part, channel, nan, 0, 0, nan, "no judged pixel shows it")
    if not above_floor(true_value(part, channel, truth)):
        return PartLeak(part, channel, nan, 0, 0, nan, f"true albedo below {ALBEDO_FLOOR}")
    usable = (prediction > 0) & (shading > 0)
    count, left_out = int(usable.sum()), int((~usable).sum())
    if not count:
        return PartLeak(part, channel, nan, 0, left_out, nan, "no pixel has both albedo and shading above 0")
    x, y = _centred(np.log(shading[usable])), _centred(np.log(prediction[usable]))
    spread = float((x * x).mean())
    if spread == 0:
        return PartLeak(part, channel, nan, count, left_out, 0.0, "the true shading does not vary")
    return PartLeak(part, channel, float((x * y).mean()) / spread, count, left_out, spread)


def _centred(values: np.ndarray) -> np.ndarray:
    """Subtract the mean from values; exactly 0 where they are all equal."""
    shifted = values - values[0]
    return shifted - shifted.mean()
