"""Settings of the `lighting` stage."""

from __future__ import annotations

from types import MappingProxyType
from typing import Literal

from pydantic import ValidationInfo, field_validator

from pipeline import Settings, UserError, group, setting
from stages.photometry.specular.settings import DarkOutlierSettings, HighlightSettings, SpecularSettings
from stages.photometry.transport.settings import (
    EnvironmentMapSettings,
    LightPictureSettings,
    VisibilitySettings,
)

STILL = 2 / 3  # of `moving_light`


class LightingSettings(Settings):
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
    samples: int = setting(
        20_000,
        "Pixels that the light is found from; a quarter as many more for every further light. More changes "
        "little.",
        unit="pixels",
        ge=1000,
        le=300_000,
    )
    neutrality: float = setting(
        0.005,
        "The price of channels that disagree about where the light comes from. More keeps the colour of "
        "paint out of the light where all that faces one way is of one colour (moss on the ground); less is "
        "for coloured lamps.",
        ge=0,
    )
    evenness: float = setting(
        1e-3,
        "The price of light that differs from direction to direction; settles what the surface does not "
        "see. A sun costs what it is bright, not the square.",
        ge=0,
    )
    bounces: int = setting(4, "How often light is passed on between surfaces; 0: not at all.", ge=0, le=100)
    brightest: float | None = setting(
        None,
        "What the brightest material reflects: it says how much light bounces. none: found, as that under "
        "which like surface in hollows and outside comes out most alike.",
        ge=0.01,
        le=0.95,
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
