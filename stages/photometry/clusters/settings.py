"""Settings of clusters of views."""

from __future__ import annotations

from pipeline import Settings, setting

LEAST_PIXELS = 1000  # fewer make no cluster


class ClusterSettings(Settings):
    """Settings of clusters of views that are solved together."""

    pixels: int = setting(
        20_000_000,
        "Pixels that take part in a cluster, at most: those of its views, and of other views those that "
        "correspond to them. Memory is about 0.65 kB for each. Fewer take more time, since what clusters "
        "share is solved in each.",
        unit="pixels",
        ge=LEAST_PIXELS,
    )
    sample_pixels: int = setting(
        10_000_000,
        "Pixels, at most, whose median brightness of the shading is what all clusters call typical.",
        unit="pixels",
        ge=LEAST_PIXELS,
    )
