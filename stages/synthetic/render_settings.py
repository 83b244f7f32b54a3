"""What can be set of a rendered experiment."""

from __future__ import annotations

from typing import Literal

from pipeline import Settings, setting
from stages.scene.albedo_floor import ALBEDO_FLOOR


class RenderSettings(Settings):
    """Settings of the `render` stage."""

    subject: Literal["bust", "relief", "courtyard"] = setting(
        "bust",
        "What is rendered where no object is given. relief: a wall with niches, half columns and steps. "
        "courtyard: ground with a well, a back wall, arcades at the sides; open in front.",
    )
    paint: Literal[
        "parts",
        "stripes",
        "texture",
        "vertex",
        "fractal",
        "masonry",
        "rubble",
        "wood",
        "rust_and_moss",
        "stains",
        "print",
        "plaster",
        "quilt",
    ] = setting(
        "parts",
        "parts: one colour each, as in the paper's Table 1. stripes: the same, with thin stripes on "
        "`striped_part`. texture: a many-coloured stone. vertex: the colours that the object brings. "
        "fractal (1/f), masonry, rubble, wood, rust_and_moss, stains, print, plaster: surfaces as in the "
        "world, with detail down to two pixels. quilt: a texture for each part, plain plaster among them.",
    )
    contrast: float = setting(
        0.2, "Standard deviation of log brightness, where the paint is one as in the world.", gt=0, le=0.8
    )
    paint_seed: int = setting(0, "Draws ground, layout and noise of such a paint.", ge=0, le=1_000_000)
    striped_part: str | None = setting("shirt", "The part that stripes cover; none: the whole subject.")
    stripe_period: float = setting(
        0.05, "Width of two stripes, one of each colour.", unit="subject radii", gt=0, le=10
    )
    light: Literal["dome", "four_lamps", "one_lamp", "sun_and_sky", "environment"] = setting(
        "dome",
        "dome: a white sky above a dim ground. four_lamps, one_lamp: extended lamps, black surroundings. "
        "sun_and_sky: a blue sky with a warm sun, above brown ground. environment: the source `environment`.",
    )
    turn_deg: float = setting(
        0.0,
        "By how much the environment, or the sky with its sun, is turned, counter-clockwise seen from above.",
        unit="°",
    )
    sun_elevation_deg: float = setting(
        40.0, "Of sun_and_sky; its azimuth is 40° to the figure's right.", unit="°", ge=5, le=85
    )
    gloss: float = setting(
        0.0, "Share of the reflection that is a rough mirror's, on `glossy_parts`.", ge=0, lt=1
    )
    glossy_parts: tuple[str, ...] = setting(
        ("hair", "plinth"), "The parts that are glossy where `gloss` is not 0. Empty: all."
    )
    roughness: float = setting(
        0.15, "Roughness α of the mirror (GGX): 0.15 makes highlights of some degrees.", gt=0, le=1
    )
    roughness_contrast: float = setting(
        0.0, "Standard deviation of the log of the roughness, a 1/f texture of its own; 0: even.", ge=0, le=1
    )
    metal_part: str | None = setting(
        None, "A part of bare metal, a mirror of `roughness` in the part's paint; its albedo is not judged."
    )
    spacing: float = setting(
        0.004,
        "Grid of the subject's mesh; 0.004 gives the bust 240 k faces.",
        unit="bust heights",
        ge=0.0015,
        le=0.05,
    )
    y_up: bool = setting(False, "Whether the object's own mesh has y upwards and faces +z.")
    object_parts: int = setting(4, "Parts that an object's own mesh is divided into.", ge=1, le=200)
    views: int = setting(13, "Views on an arc around the subject; the paper has 13.", ge=1, le=1000)
    arc_deg: float = setting(108.0, "Azimuth from the first view to the last.", unit="°", ge=0, le=360)
    elevations_deg: tuple[float, ...] = setting(
        (5.0, 20.0), "Elevations, taken in turn from view to view.", unit="°", min_length=1
    )
    distance: float = setting(4.0, "From the subject's centre.", unit="subject radii", ge=1.5, le=100)
    width_px: int = setting(540, "Width of the images; the paper has 540.", unit="px", ge=16, le=16384)
    height_px: int = setting(960, "Height of the images; the paper has 960.", unit="px", ge=16, le=16384)
    noise: float = setting(
        0.02,
        "Samples are added until the scatter of pixel values is this share of their mean.",
        gt=0,
        le=1,
    )
    reflections: int = setting(
        6, "How often light may be reflected on its way; 1: no bounces between surfaces.", ge=1, le=64
    )
    sensor_noise: float = setting(
        0.0, "Noise a sensor adds: deviation at the mean value, growing with its root.", ge=0, le=1
    )
    blur_px: float = setting(
        0.0, "Deviation of a Gaussian blur, a lens out of focus.", unit="px", ge=0, le=64
    )
    albedo_floor: float = setting(
        ALBEDO_FLOOR,
        "True shading is image over albedo only where the albedo is at least this: a darker surface reflects "
        "less itself than others send on to it.",
        gt=0,
        le=1,
    )
