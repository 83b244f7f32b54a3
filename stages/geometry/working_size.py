"""Size of the images that everything after works on: as wanted, or as fine as an expected time allows."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline import Settings, setting

MEGA = 1e6


class AutoSizeSettings(Settings):
    """Settings of `max_size_px: auto`."""

    processor_minutes: float = setting(
        42.0,
        "Processor time that a run from photos to albedo may take, about; two cores take a little more than "
        "half of it.",
        unit="min",
        gt=0,
    )
    steps_per_octave: int = setting(
        4,
        "Sizes to choose from, the photos' own first: few, so that a photo more or less seldom changes the "
        "size of all.",
        ge=1,
    )
    seconds_per_megapixel: float = setting(
        100.0,
        "Processor time that all stages take per megapixel of all working images, as measured "
        "(docs/performance.md).",
        unit="s",
        gt=0,
    )
    view_megapixels: float = setting(
        5.0,
        "Pixels of a view, at most: those of one view are in memory at once, and those of others that "
        "correspond to them. --memory lowers it.",
        unit="megapixels",
        gt=0,
    )
    least_px: int = setting(
        768, "Longest side below which the time is exceeded rather than detail lost.", unit="px", ge=32
    )


def working_size(width: int, height: int, max_size_px: int | None) -> tuple[int, int]:
    """Reduce width and height to at most `max_size_px`, aspect kept to the pixel; never enlarge."""
    scale = 1.0 if max_size_px is None else min(1.0, max_size_px / max(width, height))
    return max(1, round(width * scale)), max(1, round(height * scale))


def affordable_size(sizes: Sequence[tuple[int, int]], how: AutoSizeSettings) -> int:
    """Find the longest side at which all images together cost no more than is allowed, px.

    Parameters
    ----------
    sizes : sequence of tuple of int
        Width and height of every image, px.
    how : AutoSizeSettings
    """
    longest = max(max(size) for size in sizes)
    least, step = min(how.least_px, longest), 0
    while True:
        wanted = max(least, round(longest * 2 ** (-step / how.steps_per_octave)))
        if wanted == least or _affordable([working_size(*size, wanted) for size in sizes], how):
            return wanted
        step += 1


def expected_minutes(sizes: Sequence[tuple[int, int]], how: AutoSizeSettings) -> float:
    """Estimate the processor time of a run with images of these sizes, px; min."""
    return sum(width * height for width, height in sizes) / MEGA * how.seconds_per_megapixel / 60


def _affordable(sizes: Sequence[tuple[int, int]], how: AutoSizeSettings) -> bool:
    largest = max(width * height for width, height in sizes) / MEGA
    return largest <= how.view_megapixels and expected_minutes(sizes, how) <= how.processor_minutes
