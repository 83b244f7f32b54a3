"""All measures of a set of albedo maps, as one value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from pipeline import UserError, finite_or_null
from stages.evaluation.agreement import Correspondences, consistency
from stages.evaluation.detail import OctaveDetail, detail_remarks, octave_details
from stages.evaluation.judged_views import CHANNELS, JudgedView
from stages.evaluation.leak import PartLeak, channel_leaks, part_leaks
from stages.evaluation.part_variance import PartVariance, part_variances
from stages.evaluation.scaled_error import lmse, psnr_h, si_rmse

SCALING = (
    "linear values; one least-squares scale per channel for all views together (si-RMSE, PSNR-H, detail), "
    "one per window (LMSE), each part's median scaled to the true value (variance)"
)


@dataclass(frozen=True)
class Scores:
    """Every measure; triples are red, green, blue; nan: not measurable; inf: PSNR without error.

    Attributes
    ----------
    views, pixels : int
        Number of views and of judged pixels.
    si_rmse, si_rmse_scales, lmse : tuple of 3 floats
    psnr_h : float
        Mean over the views, dB.
    psnr_h_of_views : dict of str to float
    variances : tuple of PartVariance
        Empty where the truth names no parts.
    leak : tuple of 3 floats
        All parts together.
    leaks : tuple of PartLeak
        Empty where the truth has no parts or no shading.
    consistency : tuple of 3 floats, or None
        None where no correspondences were given.
    links : int
        Number of correspondences used.
    detail : tuple of OctaveDetail
        One per octave, finest first.
    """

    views: int
    pixels: int
    si_rmse: tuple[float, ...]
    si_rmse_scales: tuple[float, ...]
    lmse: tuple[float, ...]
    psnr_h: float
    psnr_h_of_views: dict[str, float]
    variances: tuple[PartVariance, ...]
    leak: tuple[float, ...]
    leaks: tuple[PartLeak, ...]
    consistency: tuple[float, ...] | None
    links: int
    detail: tuple[OctaveDetail, ...]

    def as_json(self) -> dict[str, Any]:
        """Convert to plain JSON values: triples by channel, null for NaN and infinities."""
        triples = {
            name: by_channel(getattr(self, name)) for name in ("si_rmse", "si_rmse_scales", "lmse", "leak")
        }
        variances = [asdict(one) | {"enters_ratios": one.enters_ratios} for one in self.variances]
        consistent = None if self.consistency is None else by_channel(self.consistency)
        plain = asdict(self) | triples | {"variances": variances, "consistency": consistent}
        return finite_or_null(plain)

    def remarks(self) -> list[str]:
        """Explain numbers that are missing or excluded from ratios, a sentence per reason and part."""
        said: dict[str, list[str]] = {}
        for measure, cells in (("variance", self.variances), ("leak", self.leaks)):
            for cell in cells:
                if cell.remark:
                    said.setdefault(f"{measure} of {cell.part}: {cell.remark}", []).append(cell.channel)
        sentences = [f"{text} ({', '.join(channels)})" for text, channels in said.items()]
        left_out = sum(leak.left_out for leak in self.leaks)
        if left_out:
            sentences.append(f"leak: {left_out} values with albedo or shading ≤ 0 were left out")
        sentences += detail_remarks(self.detail)
        if self.psnr_h == math.inf:
            sentences.append("PSNR-H: at least one view has no error at all")
        return sentences


def score_albedo(
    views: Sequence[JudgedView],
    part_names: Sequence[str] = (),
    correspondences: Correspondences | None = None,
) -> Scores:
    """Compute every measure that the given truth allows.

    Raises
    ------
    UserError
        No pixel is judged, or a part is not uniform in the truth.
    ValueError
        Two views have the same name.
    """
    if len({view.name for view in views}) < len(views):
        raise ValueError("Two views have the same name.")
    pixels = sum(int(view.judged.sum()) for view in views)
    if not pixels:
        raise UserError(
            "No pixel is judged: the masks of prediction and truth have none in common. Check that both are "
            "white where the object is."
        )
    errors, scales = si_rmse(views)
    decibels = psnr_h(views)
    leaks = part_leaks(views, part_names) if any(view.shading.any() for view in views) else ()
    agreed, links = (None, 0) if correspondences is None else consistency(views, correspondences)
    return Scores(
        views=len(views),
        pixels=pixels,
        si_rmse=errors,
        si_rmse_scales=scales,
        lmse=lmse(views),
        psnr_h=sum(decibels.values()) / len(decibels) if decibels else math.nan,
        psnr_h_of_views=decibels,
        variances=part_variances(views, part_names),
        leak=channel_leaks(leaks),
        leaks=leaks,
        consistency=agreed,
        links=links,
        detail=octave_details(views),
    )


def by_channel(values: Sequence[float]) -> dict[str, float]:
    """Label a triple with the names of its channels."""
    return dict(zip(CHANNELS, values, strict=True))
