"""Variance of albedo inside parts that should be uniform (Tables 1 and 2, footnote 5), and its ratios."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.evaluation.judged_views import CHANNELS, JudgedView, above_floor, part_values, true_value
from stages.scene.albedo_floor import ALBEDO_FLOOR

# A variance below this in the reference method is negligible: a ratio to it has no meaning.
VARIANCE_FLOOR = 0.0005


@dataclass(frozen=True)
class PartVariance:
    """One cell of Table 1.

    Attributes
    ----------
    part, channel : str
    true_albedo : float
        Linear; nan where the part has no pixel.
    pixels : int
        Over all views.
    median, scale : float
        Median of the prediction, and the factor that makes it the true value.
    variance : float
        Of the scaled prediction; nan where there is no such factor, for the reason in `remark`.
    remark : str
        Empty without a remark.
    """

    part: str
    channel: str
    true_albedo: float
    pixels: int
    median: float
    scale: float
    variance: float
    remark: str = ""

    @property
    def enters_ratios(self) -> bool:
        """True where methods may be compared by it: variance known, true albedo not below the floor."""
        return bool(np.isfinite(self.variance)) and above_floor(self.true_albedo)


@dataclass(frozen=True)
class VarianceRatio:
    """A variance divided by that of the reference method; nan for the reason in `remark`."""

    part: str
    channel: str
    variance: float
    compared_with: float
    ratio: float
    remark: str = ""


def part_variances(views: Sequence[JudgedView], part_names: Sequence[str]) -> tuple[PartVariance, ...]:
    """Compute the variance per part and channel, all views together.

    ``Var(s·ρ)`` with ``s = ρ_true / median(ρ)``, over the N pixels of the part, divided by N. Where the
    median is the true value already, 0 for 0 included, s is 1.

    Parameters
    ----------
    part_names : sequence of str
        The k-th name (from 1) is that of the pixels with k in `JudgedView.parts`.

    Raises
    ------
    UserError
        A part is not uniform in the truth.
    """
    return tuple(
        _variance(part, channel, *part_values(views, number, k)[:2])
        for number, part in enumerate(part_names, 1)
        for k, channel in enumerate(CHANNELS)
    )


def _variance(part: str, channel: str, prediction: np.ndarray, truth: np.ndarray) -> PartVariance:
    nan = float("nan")
    if not prediction.size:
        return PartVariance(part, channel, nan, 0, nan, nan, nan, "no judged pixel shows it")
    value, median = true_value(part, channel, truth), float(np.median(prediction))
    if median != value and median <= 0:
        remark = f"the prediction's median is {median:g}: no positive scale makes it {value:.4f}"
        return PartVariance(part, channel, value, prediction.size, median, nan, nan, remark)
    scale = 1.0 if median == value else value / median
    # Subtracting the true value leaves the variance unchanged, and makes that of the truth exactly zero.
    variance = float(np.var(scale * prediction - value))
    remark = "" if above_floor(value) else f"true albedo below {ALBEDO_FLOOR}: enters no ratio"
    return PartVariance(part, channel, value, prediction.size, median, scale, variance, remark)


def variance_ratios(
    variances: Sequence[PartVariance], compared_with: Sequence[PartVariance]
) -> tuple[VarianceRatio, ...]:
    """Divide a method's variances by another's, subject to `ALBEDO_FLOOR` and `VARIANCE_FLOOR`.

    Raises
    ------
    ValueError
        The two were not taken on the same parts and true values.
    """
    others = {(other.part, other.channel): other for other in compared_with}
    if others.keys() != {(one.part, one.channel) for one in variances}:
        raise ValueError("The two methods were not judged on the same parts.")
    return tuple(_ratio(one, others[one.part, one.channel]) for one in variances)


def _ratio(one: PartVariance, other: PartVariance) -> VarianceRatio:
    if not np.array_equal(one.true_albedo, other.true_albedo, equal_nan=True):
        raise ValueError(f"The true {one.channel} of {one.part} is {one.true_albedo}, {other.true_albedo}.")
    cell = (one.part, one.channel, one.variance, other.variance)
    if not (one.enters_ratios and other.enters_ratios):
        return VarianceRatio(*cell, float("nan"), one.remark or other.remark)
    if other.variance < VARIANCE_FLOOR:
        return VarianceRatio(*cell, float("nan"), f"compared with a variance below {VARIANCE_FLOOR}")
    return VarianceRatio(*cell, one.variance / other.variance)
