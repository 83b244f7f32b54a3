"""Settings of the search for suns and lamps."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pipeline import Settings, setting

Angle = Annotated[float, Field(gt=0, le=45)]
Factor = Annotated[float, Field(gt=0)]


class SunSettings(Settings):
    """Settings of the search for small sources of light: the sun, lamps."""

    most: int = setting(
        4, "Most suns and lamps. 0: light is as wide as the finest cells of directions.", ge=0, le=8
    )
    bright: float = setting(
        3.0, "Brighter directions may be those of a sun.", unit="times the mean radiance", gt=0
    )
    least_share: float = setting(
        0.05,
        "Least part of a sun in all light from everywhere: weaker ones throw no shadow that one sees.",
        unit="share of the light",
        ge=0,
        lt=1,
    )
    within_deg: Angle = setting(
        12.0,
        "Bright directions this near to their middle are tried as one sun: in cells of 5°, and with shadows "
        "that are blurred between vertices, it is up to 5° off.",
        unit="degrees",
    )
    steps_deg: tuple[Angle, ...] = setting(
        (1.5, 0.4, 0.12),
        "Distances of the directions that are tried, coarse to fine: each round covers a step of the last.",
        unit="degrees",
        min_length=1,
    )
    brightness: tuple[Factor, ...] = setting(
        (0.7, 1.0, 1.4, 2.0),
        "Brightness of a sun that is tried at first: light that was spread over several cells, whose shadows "
        "are blurred, is underestimated.",
        unit="times that of the bright directions",
        min_length=1,
    )
    gain: float = setting(
        0.01,
        "By how much less the pairs of equal albedo must disagree for a sun in place of bright directions. "
        "Without a sun, the best of some hundred tried gains .001.",
        unit="share of the disagreement",
        ge=0,
        lt=1,
    )
    rays_across: int = setting(
        2, "Rays across a sun's disc, both ways: shades of a penumbra, and its cost.", unit="rays", ge=1, le=8
    )
    radius_deg: float = setting(
        0.27,
        "Radius of a sun's disc, which makes the penumbra of shadows: our sun's.",
        unit="degrees",
        gt=0,
        le=5,
    )
