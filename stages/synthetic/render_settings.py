"""What can be set of a rendered experiment."""

from __future__ import annotations

from typing import Literal

from pipeline import Settings, setting


class RenderSettings(Settings):
    """Settings of the `render` stage."""

    paint: Literal["parts", "stripes", "texture", "vertex"] = setting(
        "parts",
        "parts: one colour each, as in the paper's Table 1. stripes: the same, with thin stripes on "
        "`striped_part`. texture: a many-coloured stone. vertex: the colours that the object brings.",
    )
    striped_part: str | None = setting("shirt", "The part that stripes cover; none: the whole subject.")
    stripe_period: float = setting(
        0.05, "Width of two stripes, one of each colour.", unit="subject radii", gt=0, le=10
    )
    light: Literal["dome", "four_lamps", "one_lamp", "environment"] = setting(
        "dome",
        "dome: a white sky above a dim ground. four_lamps, one_lamp: extended lamps, black surroundings. "
        "environment: the source `environment`.",
    )
    turn_deg: float = setting(
        0.0, "By how much the environment is turned, counter-clockwise seen from above.", unit="°"
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
    spacing: float = setting(
        0.004, "Grid of the bust's mesh; 0.004 gives 240 k faces.", unit="bust heights", ge=0.0015, le=0.05
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
