"""Settings of the `full_resolution` stage."""

from __future__ import annotations

from pipeline import Settings, group, setting
from stages.formats.images.photo_settings import MOST_TIMES_BRIGHT, FireflySettings


class FullResolutionSettings(Settings):
    """Settings of the `full_resolution` stage."""

    most_contrast: float = setting(
        4.0,
        "Greatest ratio of a pixel to its surroundings of a working pixel's size, either way: more is "
        "assumed to be noise or misregistration.",
        unit="factor",
        gt=1,
    )
    most_times_bright: float = MOST_TIMES_BRIGHT
    fireflies: FireflySettings = group(FireflySettings, "What `most_times_bright` is a multiple of.")
    finest_sigma_px: float = setting(
        1.0,
        "σ of the high-pass by which albedo and photo are compared: the albedo takes finer detail in the "
        "share in which it contains this octave of the photo.",
        unit="working px",
        gt=0,
    )
    window_px: float = setting(
        1.0,
        "σ of the Gaussian under which they are compared.",
        unit="working px",
        gt=0,
    )
    least_contrast: float = setting(
        0.002,
        "Where the photo changes by less than this, the comparison is void, and all detail is kept.",
        unit="of the logarithm",
        gt=0,
    )
    log_offset: float = setting(
        0.02,
        "Added to the photo before logarithms and quotients: detail of darker pixels is noise.",
        unit="of the photo's mean",
        gt=0,
    )
