"""Settings of the `calibration` stage."""

from __future__ import annotations

from pipeline import Settings, setting


class CalibrationSettings(Settings):
    """Settings of the `calibration` stage, which is part of a run where a card or chart is given."""

    white: tuple[str, ...] = setting(
        (),
        "Grey or white cards, as by --white: X,Y,WIDTH,HEIGHT@PHOTO=REFLECTANCE, in pixels of the photo as "
        "it is shown; one reflectance, or three for red, green and blue.",
    )
    chart: tuple[str, ...] = setting(
        (),
        "Charts of 24 patches, as by --chart: the corners of the patches dark skin, bluish green, black and "
        "white that are the chart's own, X1,Y1,…,X4,Y4@PHOTO.",
    )
    fewest_pixels: int = setting(
        6, "Working pixels with an albedo that a card or a patch must have.", unit="working px", ge=1
    )
    chart_gap: float = setting(
        0.14, "Width of what is between two patches of a chart.", unit="of a patch's side", ge=0, le=1
    )
    chart_centre: float = setting(
        0.5,
        "Middle part of each patch that is used: corners given by hand, and distortion, move the rest.",
        unit="of a patch's side",
        gt=0,
        le=1,
    )
    most_spread: float = setting(
        0.1,
        "Relative spread of the albedo within a card, or between references, from which a warning says that "
        "the scale is no better known.",
        gt=0,
    )
