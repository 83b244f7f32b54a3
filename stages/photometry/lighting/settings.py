"""Settings of the `lighting` stage."""

from __future__ import annotations

from types import MappingProxyType
from typing import Literal

from pydantic import ValidationInfo, field_validator, model_validator

from pipeline import Settings, UserError, group, setting
from stages.photometry.light_search.settings import LightSearchSettings
from stages.photometry.specular.settings import DarkOutlierSettings, HighlightSettings, SpecularSettings
from stages.photometry.transport.settings import (
    EnvironmentMapSettings,
    LightPictureSettings,
    VisibilitySettings,
)
from stages.scene.upright_settings import UPRIGHT_WITHIN_DEG

STILL = 2 / 3  # of `moving_light`: `still_light` by default


class ViewGainSettings(Settings):
    """Settings of `view_gains`: gains by corresponding pixels, and how views differ beyond them."""

    dark: float = setting(
        0.02,
        "Pixels up to this are too noisy to compare: of a view's bright pixels where these are dim, of the "
        "scaled image elsewhere.",
        unit="of the scaled image",
        gt=0,
        lt=1,
    )
    darkest: float = setting(
        0.002,
        "The same, at least, in views however dim: a few steps of eight bits.",
        unit="of the scaled image",
        gt=0,
        lt=1,
    )
    bright_percentile: float = setting(
        99.0, "Percentile of a view and channel that is its bright pixels.", unit="%", gt=0, le=100
    )
    fewest_correspondences: int = setting(
        50, "Links of a pair of views, at least, for a median over them.", unit="links", ge=1
    )
    fewest_correspondences_in_patch: int = setting(
        5, "Links of a patch, at least, for a mean over them, if any patch has as many.", unit="links", ge=1
    )
    largest_difference: float = setting(
        1.0,
        "Differences of linked pixels beyond this count as this in the mean of their patch.",
        unit="logarithm",
        gt=0,
    )

    @model_validator(mode="after")
    def _ordered(self) -> ViewGainSettings:
        if self.darkest > self.dark:
            raise ValueError("darkest at most dark")
        return self


class LightSharingSettings(Settings):
    """Settings of `lights: auto`: gloss, which only brightens, told from lights of the views' own."""

    matte_brightening: float = setting(
        1.04,
        "How far views rise above one another, against how far they fall below (RMS), up to which moving "
        "light may be what makes them differ.",
        gt=0,
    )
    glossy_brightening: float = setting(
        1.06, "The same from which on gloss is, and one light serves all views; by degrees between.", gt=0
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
        "Pixels with a channel from here on are clipped: the photo shows less than there was. Photos with "
        "values beyond 1 (linear EXR) have no white, and are never clipped.",
        unit="of white, linear",
        gt=0,
        le=1,
    )
    grazing_cosine: float = setting(
        0.1,
        "Cosine of the angle between normal and viewing direction that pixels exceed: at more than 84° "
        "surface shows mostly its neighbourhood.",
        ge=0,
        lt=1,
    )
    unlit: float = setting(
        0.02,
        "Pixels whose shading is no more have no data for the albedo: a quotient by less says nothing.",
        unit="of the median shading",
        ge=0,
        lt=1,
    )


class LightDistanceSettings(Settings):
    """Settings of the choice among distances of the light (`transfer.light_distances`)."""

    nearer_gain: float = setting(
        0.01,
        "Share by which light from nearby must leave less disagreement than light from infinitely far away "
        "to be believed in.",
        ge=0,
        lt=1,
    )


class KnownLightSettings(Settings):
    """Settings of `turn_of`: the search for the turn of a known light about the vertical."""

    turn_step_deg: int = setting(
        5, "Between turns that are compared first, without bounces.", unit="°", ge=1, le=90
    )
    finalists: int = setting(
        3, "Turns of these, with no better neighbour, that are compared with the bounces that each has.", ge=1
    )
    fine_turn_step_deg: int = setting(
        1, "Between turns around the best of these that are compared last.", unit="°", ge=1, le=90
    )
    picture_rows: int = setting(
        128,
        "Rows that the picture is reduced to while turns are compared: 1.4° each, where directions are some "
        "13° apart.",
        unit="px",
        ge=8,
    )


class LightingSettings(LightSearchSettings):
    """Settings of the `lighting` stage: light of at least 0 from all around, found before the albedo."""

    moved = MappingProxyType({"sheen": "lighting.specular.remove"})

    lights: Literal["auto", "shared", "per-view"] = setting(
        "auto",
        "shared: one light for all views, with a gain per view and channel. per-view: a light each, as when "
        "lamps are carried about or clouds pass. auto: by `still_light` and `moving_light`; light that is "
        "brighter in only a few of many views passes for gloss there.",
    )
    moving_light: float = setting(
        0.3,
        "`lights: auto`: where the same surface point differs by as much as this from view to view, after "
        "gains, each view has its own light, unless views rise further above one another than they fall "
        "below: that is gloss, which only adds. Moved lamps or things have .3 to .7.",
        unit="typical difference of the logarithms",
        gt=0,
    )
    still_light: float | None = setting(
        None,
        "`lights: auto`: up to this difference one light serves all views; photos of still things have .05 "
        "to .2 (flare, gloss, clouds). Between this and `moving_light` both are found and mixed, by degrees. "
        "none: two thirds of `moving_light`.",
        unit="typical difference of the logarithms",
        ge=0,
    )
    known_turn_deg: float | None = setting(
        None,
        "`--known-light`: by how much its picture is turned about the vertical, counter-clockwise seen from "
        "above; none: found, to a degree.",
        unit="°",
    )
    known_scale: Literal["fitted", "fixed"] = setting(
        "fitted",
        "`--known-light`. fitted: every channel of its picture has a factor of its own, such that shading is "
        "1 on average, as under light that is found; `brightest` says how much bounces. fixed: its values "
        "are in the photos' unit (what is white, in light of 1 all around, has the value 1), so that the "
        "albedo is absolute.",
    )

    gains: ViewGainSettings = group(
        ViewGainSettings, "Gains of the views, by corresponding pixels, and how views differ beyond them."
    )
    sharing: LightSharingSettings = group(
        LightSharingSettings,
        "`lights: auto`: gloss, which only brightens, told from lights that each view has of its own.",
    )
    trusted_pixels: TrustedPixelSettings = group(
        TrustedPixelSettings, "Pixels whose data count, for the light and for the albedo."
    )
    distance: LightDistanceSettings = group(
        LightDistanceSettings, "The choice among distances of the light (`transfer.light_distances`)."
    )
    known_light: KnownLightSettings = group(
        KnownLightSettings, "`--known-light`: the search for the turn of its picture about the vertical."
    )
    highlights: HighlightSettings = group(
        HighlightSettings,
        "One light for all views: what a view sees of its surface beyond what the others see of it is taken "
        "off.",
    )
    dark_outliers: DarkOutlierSettings = group(
        DarkOutlierSettings,
        "One light for all views: pixels that most other views contradict, for they see the place far "
        "brighter, are left out.",
    )
    specular: SpecularSettings = group(
        SpecularSettings,
        "One light for all views: specular reflection, the light's image in glossy surface.",
    )
    upright_within_deg: float = UPRIGHT_WITHIN_DEG
    visibility: VisibilitySettings = group(
        VisibilitySettings,
        "In which of the finer directions, where light is bright, vertices see the sky; as of `transfer`.",
    )
    environment_map: EnvironmentMapSettings = group(
        EnvironmentMapSettings, "`--known-light`: the picture of all directions that the light is given as."
    )
    light_pictures: LightPictureSettings = group(
        LightPictureSettings, "Pictures of all directions of the light that is found."
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
        """`still_light`, or what it is by default."""
        return STILL * self.moving_light if self.still_light is None else self.still_light


def check_known_light(settings: LightingSettings, kind: str) -> None:
    """Refuse a known light that is not asked for: another kind of light, or one for each view.

    Raises
    ------
    UserError
        It is not.
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
