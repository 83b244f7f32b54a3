"""Settings of the `full_resolution` stage."""

from __future__ import annotations

from pipeline import Settings, group, setting
from stages.formats.images.photo_settings import MOST_TIMES_BRIGHT, FireflySettings


class FullResolutionSettings(Settings):
    """Settings of the `full_resolution` stage."""

    most_contrast: float = setting(
        4.0,
        "By how much a pixel may be brighter or darker than its surroundings of a working pixel's size: more "
        "is taken for noise or misfit.",
        unit="factor",
        gt=1,
    )
    most_times_bright: float = MOST_TIMES_BRIGHT
    fireflies: FireflySettings = group(FireflySettings, "What `most_times_bright` is a multiple of.")
    finest_sigma_px: float = setting(
        1.0,
        "Albedo and photo are compared by what is finer than this σ in both: only as far as the albedo has "
        "that of the photo, it gets what is finer still.",
        unit="working px",
        gt=0,
    )
    window_px: float = setting(
        1.0,
        "σ of the surroundings that they are compared in.",
        unit="working px",
        gt=0,
    )
    least_contrast: float = setting(
        0.002,
        "Where the photo changes by less than this there is nothing to compare, and all is kept.",
        unit="of the logarithm",
        gt=0,
    )
    log_offset: float = setting(
        0.02,
        "Added to the photo before logarithms and quotients: in darker pixels, detail is noise.",
        unit="of the photo's mean",
        gt=0,
    )
