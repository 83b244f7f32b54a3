"""Settings that every stage shares which reads photos."""

from pipeline import Settings, setting

MOST_TIMES_BRIGHT: float = setting(
    1000.0,
    "Pixels brighter than this, as renderers leave them where a path met a lamp by chance, are no light from "
    "a surface: they are masked, counted and said, as are those that are not numbers.",
    unit="times what 97 % of the lit pixels of an EXR or HDR are below, and of what is around",
    ge=10,
)


class FireflySettings(Settings):
    """Settings of what `most_times_bright` is a multiple of: `stages.formats.images.masked_photos`."""

    photo_quantile: float = setting(
        0.97,
        "The level of a whole photo is this quantile of its lit pixels: what is brighter is a lamp or a "
        "glint rather than surface.",
        gt=0,
        le=1,
    )
    neighbourhood_px: int = setting(
        2, "Half size of the square around a pixel that has a level of its own.", unit="px", ge=1, le=16
    )
    brighter_neighbours: float = setting(
        0.2,
        "That level is what this share of the square is brighter than: more than come out wrong together.",
        gt=0,
        le=1,
    )
