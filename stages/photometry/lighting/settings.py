"""Settings of the `lighting` stage."""

from __future__ import annotations

from types import MappingProxyType
from typing import Literal

from pydantic import ValidationInfo, field_validator, model_validator

from pipeline import Settings, UserError, group, setting
from stages.photometry.clusters.settings import LEAST_PIXELS, ClusterSettings
from stages.photometry.light_search.settings import LightSearchSettings
from stages.photometry.specular.settings import DarkOutlierSettings, HighlightSettings, SpecularSettings
from stages.photometry.sun.settings import SunSettings
from stages.photometry.transport.settings import (
    EnvironmentMapSettings,
    LightPictureSettings,
    VisibilitySettings,
)
from stages.scene.upright_settings import UPRIGHT_WITHIN_DEG

STILL = 2 / 3  # of `moving_light`: `still_light` by default


class ViewGainSettings(Settings):
    """Settings of `view_gains`: gains from corresponding pixels, and the spread that remains."""

    dark: float = setting(
        0.02,
        "Pixels up to this are too noisy to compare; relative to a view's bright pixels where these are dim, "
        "to the scaled image elsewhere.",
        unit="of the scaled image",
        gt=0,
        lt=1,
    )
    darkest: float = setting(
        0.002,
        "Lower bound of that threshold in dim views: a few steps of eight bits.",
        unit="of the scaled image",
        gt=0,
        lt=1,
    )
    bright_percentile: float = setting(
        99.0, "Percentile of a view and channel that stands for its bright pixels.", unit="%", gt=0, le=100
    )
    fewest_correspondences: int = setting(
        50, "Fewest correspondences of a pair of views for their median.", unit="correspondences", ge=1
    )
    fewest_correspondences_in_patch: int = setting(
        5,
        "Fewest correspondences of a patch for their mean, if any patch has as many.",
        unit="correspondences",
        ge=1,
    )
    largest_difference: float = setting(
        1.0,
        "Differences of corresponding pixels are clipped to this in the mean of their patch.",
        unit="logarithm",
        gt=0,
    )

    @model_validator(mode="after")
    def _ordered(self) -> ViewGainSettings:
        if self.darkest > self.dark:
            raise ValueError("darkest at most dark")
        return self


class LightSharingSettings(Settings):
    """Settings of `lights: auto`: gloss, which only brightens, is distinguished from per-view lights."""

    matte_brightening: float = setting(
        1.04,
        "Largest ratio of positive to negative differences between views (RMS) that moving light may "
        "explain.",
        gt=0,
    )
    glossy_brightening: float = setting(
        1.06,
        "Ratio from which on gloss explains them, and all views share a light; weighted by degrees between.",
        gt=0,
    )

    @model_validator(mode="after")
    def _ordered(self) -> LightSharingSettings:
        if self.matte_brightening >= self.glossy_brightening:
            raise ValueError("matte_brightening less than glossy_brightening")
        return self


class TrustedPixelSettings(Settings):
    """Settings of which pixels' data count, for the light and for the albedo."""

    saturation: float = setting(
        0.98,
        "Pixels with a channel from here on are clipped: their radiance was larger. Photos with values "
        "beyond 1 (linear EXR) have no white point, and are never clipped.",
        unit="of white, linear",
        gt=0,
        le=1,
    )
    grazing_cosine: float = setting(
        0.1,
        "Cosine of the angle between normal and viewing direction that trusted pixels exceed: beyond 84° "
        "surface mostly reflects its neighbourhood.",
        ge=0,
        lt=1,
    )
    unlit: float = setting(
        0.02,
        "Pixels with no more shading have no data for the albedo: a quotient by less is mostly noise.",
        unit="of the median shading",
        ge=0,
        lt=1,
    )


class LightDistanceSettings(Settings):
    """Settings of the choice among distances of the light (`transfer.light_distances`)."""

    nearer_gain: float = setting(
        0.01,
        "Share by which light from nearby must leave less disagreement than light from infinity to be "
        "chosen.",
        ge=0,
        lt=1,
    )


class KnownLightSettings(Settings):
    """Settings of `turn_of`: the search for the yaw of a known light (rotation about the vertical)."""

    turn_step_deg: int = setting(
        5, "Step between yaws that are compared first, without bounces.", unit="°", ge=1, le=90
    )
    finalists: int = setting(3, "Local minima among these that are compared with their own bounces.", ge=1)
    fine_turn_step_deg: int = setting(
        1, "Step between yaws around the best of these that are compared last.", unit="°", ge=1, le=90
    )
    picture_rows: int = setting(
        128,
        "Rows that the picture is reduced to while yaws are compared: 1.4° each, where directions are some "
        "13° apart.",
        unit="px",
        ge=8,
    )


class LightingSettings(LightSearchSettings):
    """Settings of the `lighting` stage: non-negative light from all around, estimated before the albedo."""

    moved = MappingProxyType({"sheen": "lighting.specular.remove"})

    lights: Literal["auto", "shared", "per-view"] = setting(
        "auto",
        "shared: one light for all views, with a gain per view and channel. per-view: a light for each view, "
        "for moved lamps or passing clouds. auto: by `still_light` and `moving_light`; light that is "
        "brighter in only a few of many views cannot be distinguished from gloss there.",
    )
    moving_light: float = setting(
        0.3,
        "`lights: auto`: difference of corresponding pixels between views, after gains, from which on each "
        "view has its own light, unless positive differences exceed negative ones: that is gloss, which only "
        "adds. Moved lamps or objects give .3 to .7.",
        unit="typical difference of the logarithms",
        gt=0,
    )
    still_light: float | None = setting(
        None,
        "`lights: auto`: up to this difference all views share a light; photos of static scenes have .05 to "
        ".2 (flare, gloss, clouds). Between this and `moving_light` both are estimated and mixed by degrees. "
        "none: two thirds of `moving_light`.",
        unit="typical difference of the logarithms",
        ge=0,
    )
    sun: SunSettings = group(
        SunSettings, "Suns and lamps in place of bright directions, with shadows as sharp as the photos'."
    )
    known_turn_deg: float | None = setting(
        None,
        "`--known-light`: yaw of its picture (rotation about the vertical), counter-clockwise seen from "
        "above; none: estimated, to a degree.",
        unit="°",
    )
    known_scale: Literal["fitted", "fixed"] = setting(
        "fitted",
        "`--known-light`. fitted: every channel of its picture has a factor of its own, such that shading is "
        "1 on average, as under estimated light; `brightest` sets the scale of interreflection. fixed: its "
        "values are in the photos' unit (a white surface under uniform light of 1 has the value 1), so that "
        "the albedo is absolute.",
    )

    pixels: int = setting(
        10_000_000,
        "Masked pixels, at most, of the views that the light is estimated from: all, or some from every part "
        "of the scene; the pixels of all are then lit in clusters. Memory is about 0.3 kB for each.",
        unit="pixels",
        ge=LEAST_PIXELS,
    )
    clusters: ClusterSettings = group(
        ClusterSettings, "Of more pixels than the light is estimated from, all are lit in clusters."
    )
    gains: ViewGainSettings = group(
        ViewGainSettings, "Gains of the views from corresponding pixels, and the spread that remains."
    )
    sharing: LightSharingSettings = group(
        LightSharingSettings,
        "`lights: auto`: gloss, which only brightens, is distinguished from per-view lights.",
    )
    trusted_pixels: TrustedPixelSettings = group(
        TrustedPixelSettings, "Pixels whose data count, for the light and for the albedo."
    )
    distance: LightDistanceSettings = group(
        LightDistanceSettings, "The choice among distances of the light (`transfer.light_distances`)."
    )
    known_light: KnownLightSettings = group(
        KnownLightSettings, "`--known-light`: the search for the yaw of its picture."
    )
    highlights: HighlightSettings = group(
        HighlightSettings,
        "One light for all views: radiance of a view in excess of the others at the same surface is removed.",
    )
    dark_outliers: DarkOutlierSettings = group(
        DarkOutlierSettings,
        "One light for all views: pixels are left out that are far darker than their correspondences in most "
        "other views.",
    )
    specular: SpecularSettings = group(
        SpecularSettings,
        "One light for all views: specular reflection, the mirror image of the light in glossy surface.",
    )
    upright_within_deg: float = UPRIGHT_WITHIN_DEG
    visibility: VisibilitySettings = group(
        VisibilitySettings,
        "Visibility of the sky from vertices in the finer directions of bright light; as in `transfer`.",
    )
    environment_map: EnvironmentMapSettings = group(
        EnvironmentMapSettings, "`--known-light`: the environment map that the light is given as."
    )
    light_pictures: LightPictureSettings = group(
        LightPictureSettings, "Environment maps of the estimated light that are written."
    )

    @field_validator("still_light")
    @classmethod
    def _less_than_moving(cls, still: float | None, others: ValidationInfo) -> float | None:
        moving = others.data.get("moving_light")  # missing where it is refused itself
        if still is not None and moving is not None and still >= moving:
            raise ValueError(f"less than moving_light, which is {moving:g}")
        return still

    @property
    def still_up_to(self) -> float:
        """`still_light`, or its default."""
        return STILL * self.moving_light if self.still_light is None else self.still_light


def check_known_light(settings: LightingSettings, kind: str) -> None:
    """Refuse a known light with settings that cannot use it: another kind of light, or one per view.

    Raises
    ------
    UserError
        The kind is not `directions`, or the lights are per view.
    """
    if kind != "directions":
        raise UserError(
            f"A known light was given, but the light is of the kind {kind!r}, which is found with the "
            "albedo; expected decomposition.mode=transfer and decomposition.light=directions. Leave the "
            "light out, or change these."
        )
    if settings.lights == "per-view":
        raise UserError(
            "A known light was given, but lighting.lights is per-view; one picture is one light for all "
            "views. Leave one of them out."
        )
