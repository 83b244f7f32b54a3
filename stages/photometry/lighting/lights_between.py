"""Light between one for all views and one for each of them: both are found, and mixed by their weight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stages.photometry.lighting.light_estimate import FoundLight, SkySettings
from stages.photometry.lighting.lit_photos import Photos
from stages.photometry.transport.lit_scenes import SkyScene


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
