"""How much the brightest material reflects: told by the light that surfaces send one another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.settings import ReflectanceSettings


@dataclass(frozen=True, eq=False)
class Reflectance:
    """What the brightest material reflects, and how that was told.

    Attributes
    ----------
    value : float
    tried : dict of float to float
        What pairs of like paint disagreed by under each that was tried.
    light : LightEstimate
        Under that tried one which is nearest to `value`.
    """

    value: float
    tried: dict[float, float]
    light: LightEstimate

    def as_json(self) -> dict[str, Any]:
        """For records."""
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
    """Find what the brightest material reflects.

    Parameters
    ----------
    light : callable
        The light if that material reflects so much, going on from a light that is near.
    disagreements : callable
        What pairs of like paint disagree by under each of several lights, on the same pairs.
    near : LightEstimate
        That to begin from.
    step : callable
        Called after every light that is tried.
    first : float
        Reflectance to begin at.
    how : ReflectanceSettings

    Notes
    -----
    Where light bounces, surface in hollows is brighter than what it sees of the sky makes it. If too much is
    taken to bounce, the albedo in hollows comes out too dark; if too little, too bright: pairs of like paint,
    one in a hollow and one outside, disagree least under the reflectance that is true. Those tried are a
    factor apart, downhill from the first; then a parabola through the lowest and its neighbours, in the
    logarithm.
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
    """What a disagreement is multiplied by: 1 for the usual reflectance."""
    return 1 + how.unusual_price * float(np.log2(reflectance / how.usual)) ** 2


def _least(left: dict[float, float], how: ReflectanceSettings) -> float:
    """That under which least is left, for its price; of equals, the most usual."""
    return min(left, key=lambda one: (_price(one, how) * left[one], abs(np.log(one / how.usual))))


def _lowest(left: dict[float, float], how: ReflectanceSettings) -> float:
    """Where the parabola through the lowest and its neighbours, in the logarithm, is lowest."""
    tried = sorted(left)
    best = tried.index(_least(left, how))
    if best in (0, len(tried) - 1):
        return tried[best]
    three = tried[best - 1 : best + 2]
    curve = np.polyfit(np.log(three), [_price(one, how) * left[one] for one in three], 2)
    return float(np.exp(-curve[1] / (2 * curve[0]))) if curve[0] > 0 else tried[best]
