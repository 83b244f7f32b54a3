"""Comparison of all views of two results: one scale first, then pictures of a size at which all fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from stages.reporting.comparison.comparison_page import ComparedView
from stages.reporting.comparison.paired_views import (
    Pictures,
    Ratio,
    Side,
    difference_of,
    paired_pictures,
    ratio_of,
    sampled_albedos,
)
from stages.reporting.content.picture_size import encode_webp, longest_side, reduced_picture
from stages.reporting.settings import ComparisonSettings, PictureSettings


@dataclass(frozen=True)
class ComparedViews:
    """The views of both results, and how their albedos relate.

    Attributes
    ----------
    views : list of ComparedView
    ratio : Ratio
    difference : list of float, or None
    """

    views: list[ComparedView]
    ratio: Ratio
    difference: list[float] | None


def compare_views(
    a: Side,
    b: Side,
    names: Sequence[str],
    executor: Executor,
    step: Callable[[], None],
    pictures: PictureSettings,
    how: ComparisonSettings,
) -> ComparedViews:
    """Compare views, many at a time; `step` is called twice for each.

    Parameters
    ----------
    a, b : Side
    names : sequence of str
        Of views that both have; at least one.
    executor : Executor
    step : callable
    pictures : PictureSettings
    how : ComparisonSettings
    """

    def sampled(name: str) -> tuple[np.ndarray, np.ndarray]:
        found = sampled_albedos(a, b, name, pictures.largest_px, how.pixels)
        step()
        return found

    samples = list(executor.map(sampled, names))
    ratio = ratio_of(samples, how)
    side = _side(a, b, names, ratio, pictures)

    def compared(number: int) -> ComparedView:
        name = names[number]
        found = _encoded(a, b, name, side, ratio, pictures, difference_of([samples[number]], ratio))
        step()
        return found

    return ComparedViews(
        list(executor.map(compared, range(len(names)))), ratio, difference_of(samples, ratio)
    )


def _encoded(
    a: Side,
    b: Side,
    name: str,
    longest_px: int,
    ratio: Ratio,
    how: PictureSettings,
    difference: list[float] | None,
) -> ComparedView:
    """Compress the pictures of a view."""
    found = paired_pictures(a, b, name, longest_px, ratio, how)
    photo, _ = found["photo"]
    small = encode_webp(reduced_picture(photo, how.thumbnail_px), None, how)
    encoded = {kind: encode_webp(*picture, how) for kind, picture in found.items()}
    return ComparedView(name, photo.shape[1], photo.shape[0], encoded, small, difference)


def _side(a: Side, b: Side, names: Sequence[str], ratio: Ratio, how: PictureSettings) -> int:
    """Choose the longest side of pictures, by the bytes that those of some views take."""
    step = max(1, -(-len(names) // how.tried_views))
    tried = [paired_pictures(a, b, name, how.largest_px, ratio, how) for name in names[::step]]

    def bytes_at(side: int) -> float:
        return sum(_bytes_of(one, side, how) for one in tried) / len(tried) * len(names)

    return longest_side(how.largest_px, bytes_at, how.megabytes * 1e6)


def _bytes_of(pictures: Pictures, side: int, how: PictureSettings) -> int:
    """Count the bytes of a view's pictures at a longest side."""
    taken = 0
    for pixels, visible in pictures.values():
        shown = None if visible is None else reduced_picture(visible.astype(np.uint8), side) > 0
        taken += len(encode_webp(reduced_picture(pixels, side), shown, how))
    return taken
