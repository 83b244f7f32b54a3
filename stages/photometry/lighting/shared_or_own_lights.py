"""One light for all views, or one for each of them: their weights, and the mixture of both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from stages.photometry.lighting.light_estimate import FoundLight, SkySettings
from stages.photometry.transport.lit_scenes import SkyScene

if TYPE_CHECKING:
    from stages.photometry.lighting.lit_photos import Photos

MATT, GLOSSY = 1.04, 1.06  # `brightening` up to which views do not differ by gloss, and from which they do


@dataclass(frozen=True)
class Lighting:
    """One light for all views, one for each, or what lies between.

    Attributes
    ----------
    asked : str
        auto: by what follows, and `MATT` and `GLOSSY`.
    still, moving : float
        Spread of the views (see `ViewGains`) up to which one light is taken to serve all, and from which on
        each has its own, unless they differ as gloss makes them (see `brightening`).
    """

    asked: Literal["auto", "shared", "per-view"]
    still: float
    moving: float

    def apart(self, spread: float, rise: float) -> float:
        """Weigh lights of the views' own against one for all: from 0, one light, to 1, each its own."""
        if self.asked != "auto":
            return float(self.asked == "per-view")
        moved = (spread - self.still) / (self.moving - self.still)
        matt = (GLOSSY - rise) / (GLOSSY - MATT)
        return float(np.clip(moved, 0, 1) * np.clip(matt, 0, 1))


def mixed_with_own_lights(
    shared: Photos,
    apart: Photos,
    scene: SkyScene,
    light: FoundLight,
    settings: SkySettings,
    step: Callable[[], None],
) -> tuple[Photos, FoundLight]:
    """Mix one light for all views with lights of their own, by `Photos.apart`.

    Parameters
    ----------
    shared, apart : Photos
        As seen in one light, which may have gloss taken off, and in a light for each view.
    scene : SkyScene
    light : FoundLight
        The one light.
    settings : SkySettings
        By which the others are found.
    step : callable
        Called after every scale of the search.

    Returns
    -------
    tuple of Photos and FoundLight
        One light for each view, from as far away as the one. Shading is linear in light, so that the shading
        by the mixture is the mixture of both shadings, each of mean 1; of gloss, as much is taken off.
    """
    weight = np.float32(shared.apart)
    own = _of_mean_one(apart, scene, apart.light(scene, settings, step))
    one = _of_mean_one(shared, scene, light)
    found = FoundLight(
        (1 - weight) * one.radiance + weight * own.radiance, (1 - weight) * one.bounced + weight * own.bounced
    )
    photos = replace(
        apart,
        seen=(1 - weight) * shared.seen + weight * apart.seen,
        matt=(1 - weight) * shared.matt + weight * apart.matt,
        looks=shared.looks,
    )
    return photos, found


def _of_mean_one(photos: Photos, scene: SkyScene, found: FoundLight) -> FoundLight:
    """A light, scaled so that its mean shading is 1 in each channel."""
    mean = photos.shading(scene, found).mean(axis=0, dtype=np.float64)
    mean = np.where(mean > 0, mean, 1)
    return FoundLight(found.radiance / mean, (found.bounced / mean).astype(np.float32))
