"""What a run on a set of photos is expected to take: size, processor time, memory, disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stages.geometry.working_size import (
    MEGA,
    AutoSizeSettings,
    affordable_size,
    expected_minutes,
    working_size,
)
from stages.photometry.clusters.settings import ClusterSettings, expected_size
from stages.scene.memory_of_views import BYTES_OF_LIBRARIES, BYTES_PER_PIXEL_OF_CLUSTER

# All that `run` keeps, over the pixels of all working images: 196 bytes on fountain-P11 (11 of
# 768×512), with the defaults.
BYTES_ON_DISK_PER_PIXEL = 196


@dataclass(frozen=True)
class Expectation:
    """What a run from photos to albedo takes at one size, with the defaults.

    Attributes
    ----------
    photos : int
    longest_px : int
        Longest side of the working images.
    whole_px : int
        Longest side of the photos.
    processor_minutes : float
        By `expected_minutes`.
    memory_bytes : int
        Of the stage that takes most, `decomposition`, if masks leave all pixels.
    disk_bytes : int
        Of the workspace.
    """

    photos: int
    longest_px: int
    whole_px: int
    processor_minutes: float
    memory_bytes: int
    disk_bytes: int


def expected(
    sizes: Sequence[tuple[int, int]],
    longest_px: int | None,
    auto: AutoSizeSettings,
    clusters: ClusterSettings,
) -> Expectation:
    """Estimate what a run takes.

    Parameters
    ----------
    sizes : sequence of tuple of int
        Width and height of every photo, px; at least one.
    longest_px : int or None
        Longest side of the working images; None: that of the photos.
    auto : AutoSizeSettings
    clusters : ClusterSettings
    """
    reduced = [working_size(*size, longest_px) for size in sizes]
    pixels = sum(width * height for width, height in reduced)
    return Expectation(
        photos=len(sizes),
        longest_px=max(map(max, reduced)),
        whole_px=max(map(max, sizes)),
        processor_minutes=expected_minutes(reduced, auto),
        memory_bytes=BYTES_OF_LIBRARIES + BYTES_PER_PIXEL_OF_CLUSTER * expected_size(pixels, clusters),
        disk_bytes=BYTES_ON_DISK_PER_PIXEL * pixels,
    )


def chosen_size(
    sizes: Sequence[tuple[int, int]], longest_px: int | str | None, auto: AutoSizeSettings
) -> int | None:
    """Find the longest side of working images, px, from `undistort.max_size_px`; None: the photos' own."""
    if isinstance(longest_px, str):
        return affordable_size(sizes, auto)
    return longest_px


def of_megapixels(photos: int, megapixels: float) -> list[tuple[int, int]]:
    """List the sizes of so many photos of so many megapixels, px, at the usual ratio of 3 to 2."""
    height = (megapixels * MEGA * 2 / 3) ** 0.5
    return [(round(height * 1.5), round(height))] * photos
