"""Settings that every stage shares which reads photos."""

from pipeline import setting

MOST_TIMES_BRIGHT: float = setting(
    1000.0,
    "Pixels brighter than this, as renderers leave them where a path met a lamp by chance, are no light from "
    "a surface: they are masked, counted and said, as are those that are not numbers.",
    unit="times what 97 % of the lit pixels of an EXR or HDR are below, and of what is around",
    ge=10,
)
