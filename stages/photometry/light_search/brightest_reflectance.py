"""Estimation of the reflectance of the brightest material from interreflection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.settings import ReflectanceSettings


@dataclass(frozen=True, eq=False)
class Reflectance:
    """Reflectance of the brightest material, with the losses that it was estimated from.

    Attributes
    ----------
    value : float
    tried : dict of float to float
        Loss of pairs of equal albedo under each reflectance that was tried.
    light : LightEstimate
        Under the tried reflectance nearest to `value`.
    """

    value: float
    tried: dict[float, float]
    light: LightEstimate

    def as_json(self) -> dict[str, Any]:
        """Convert to plain values for records."""
        tried = {f"{one:g}": round(left, 5) for one, left in sorted(self.tried.items())}
        return {"reflects": round(self.value, 3), "disagreement": tried}


def reflectance_of(
    light: Callable[[float, LightEstimate], LightEstimate],
    disagreements: Callable[[Sequence[LightEstimate]], list[float]],
    near: LightEstimate,
    step: Callable[[], None],
    first: float,
    how: ReflectanceSettings,
) -> Reflectance:
    """Estimate the reflectance of the brightest material.

    Parameters
    ----------
    light : callable
        Estimates the light under a reflectance, starting from a given light.
    disagreements : callable
        Computes the loss of pairs of equal albedo under each of several lights, on the same pairs.
    near : LightEstimate
        Initial light.
    step : callable
        Called after every light that is tried.
    first : float
        Initial reflectance.
    how : ReflectanceSettings

    Notes
    -----
    Interreflection brightens concave surface beyond its direct light from the sky. Assuming too much of it
    makes the albedo there too dark, too little makes it too bright. The loss of pairs of equal albedo, one
    pixel in a concavity and one outside, is therefore least under the true reflectance. The loss is descended
    over reflectances a factor apart; the result is the vertex of the parabola, in the logarithm, through the
    lowest and its neighbours.
    """
    scale = how.tried
    best = int(np.argmin(np.abs(np.log(np.array(scale) / first))))
    lights, further = dict[int, LightEstimate](), {best}
    while further:
        for one in sorted(further):
            lights[one] = light(scale[one], lights.get(best, near))
            step()
        tried = sorted(lights)
        left = dict(
            zip((scale[one] for one in tried), disagreements([lights[one] for one in tried]), strict=True)
        )
        best = scale.index(_least(left, how))
        further = {one for one in (best - 1, best + 1) if 0 <= one < len(scale)} - lights.keys()
    value = _lowest(left, how)
    nearest = min(lights, key=lambda one: abs(np.log(scale[one] / value)))
    return Reflectance(value, left, lights[nearest])


def _price(reflectance: float, how: ReflectanceSettings) -> float:
    """Compute the prior factor ``1 + c log₂(r / usual)²`` of the loss: 1 for the usual reflectance."""
    return 1 + how.unusual_price * float(np.log2(reflectance / how.usual)) ** 2


def _least(left: dict[float, float], how: ReflectanceSettings) -> float:
    """Choose the reflectance of the least loss times prior; of equals, the most usual."""
    return min(left, key=lambda one: (_price(one, how) * left[one], abs(np.log(one / how.usual))))


def _lowest(left: dict[float, float], how: ReflectanceSettings) -> float:
    """Compute the vertex of the parabola through the lowest and its neighbours, in the logarithm."""
    tried = sorted(left)
    best = tried.index(_least(left, how))
    if best in (0, len(tried) - 1):
        return tried[best]
    three = tried[best - 1 : best + 2]
    curve = np.polyfit(np.log(three), [_price(one, how) * left[one] for one in three], 2)
    return float(np.exp(-curve[1] / (2 * curve[0]))) if curve[0] > 0 else tried[best]
