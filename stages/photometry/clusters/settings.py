"""Settings of clusters: parts of the surface that are solved one by one."""

from __future__ import annotations

from typing import Self

from pipeline import Settings, setting

LEAST_PIXELS = 1000  # fewer make no cluster


class ClusterSettings(Settings):
    """Settings of clusters: parts of the surface whose pixels, of all views, are solved together."""

    pixels: int = setting(
        20_000_000,
        "Pixels that take part in a cluster, at most: all that show its part of the surface, and those of "
        "the margin around it. Memory is about 0.5 kB for each.",
        unit="pixels",
        ge=LEAST_PIXELS,
    )
    margin: float = setting(
        0.1,
        "Width of the margin around a cluster's part of the surface. Its pixels take part, but their values "
        "are taken from the neighbouring cluster. It is wider than the patches and octaves in which photos "
        "are compared.",
        unit="mean sides of the views",
        gt=0,
        le=1,
    )
    sample_pixels: int = setting(
        1_000_000,
        "Pixels, at most, evenly from all views, by which the surface is divided.",
        unit="pixels",
        ge=LEAST_PIXELS,
    )
    most_margin: float = setting(
        3.0,
        "No further division once all clusters together have this many times the pixels of all views: the "
        "margins would be most of them. More memory is then needed, and said.",
        unit="of all pixels",
        ge=1.1,
        le=100,
    )

    def margin_px(self, side_px: float) -> float:
        """Compute the width of the margin in pixels of views with such a mean side."""
        return self.margin * side_px

    def margin_in_words(self) -> str:
        """Name the setting that narrows the margin, with its value."""
        return f"clusters.margin, now {self.margin:g} of a view's side"

    def within(self, pixels: int) -> Self:
        """Bound the pixels of a cluster by those that there is room for."""
        return self.model_copy(update={"pixels": min(self.pixels, max(pixels, LEAST_PIXELS))})


class AlbedoClusterSettings(ClusterSettings):
    """Settings of the clusters that the albedo is solved in."""

    margin: float = setting(
        0.15,
        "Width of the margin around a cluster's part of the surface. Its pixels take part, but their values "
        "are taken from the neighbouring cluster. At 0.1 the detail, whose widest windows end there, differs "
        "by 0.0012 of its range from that of one cluster (RMS), at 0.15 by 0.0007.",
        unit="mean sides of the views",
        gt=0,
        le=1,
    )
    widest_margin_px: float = setting(
        128.0,
        "The margin is no wider than this, however large the views: four times the σ of the detail's widest "
        "windows, which are of pixels. Else clusters of 24 megapixel photos would be mostly margins.",
        unit="px",
        gt=0,
        le=10_000,
    )
    coarse_share: float = setting(
        0.5,
        "Greatest share of a cluster's pixels that the finest of the coarse levels has which are solved for "
        "all clusters together. Each cluster begins from it, and is held at it beyond its margin.",
        unit="of `pixels`",
        gt=0,
        le=1,
    )

    def margin_px(self, side_px: float) -> float:
        """Compute the width of the margin in pixels of views with such a mean side, up to the widest."""
        return min(super().margin_px(side_px), self.widest_margin_px)

    def margin_in_words(self) -> str:
        """Name the two settings that narrow the margin, with their values."""
        return f"{super().margin_in_words()}, and clusters.widest_margin_px, {self.widest_margin_px:g}"


def expected_size(pixels: int, how: ClusterSettings) -> int:
    """Estimate how many pixels take part in the largest cluster, before the surface is divided."""
    return min(pixels, how.pixels)
