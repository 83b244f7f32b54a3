"""One light for all views, or one for each of them: their weights, and the mixture of both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.transport.lit_scenes import LitScene

if TYPE_CHECKING:
    from stages.photometry.lighting.observations import Observations


def weight_of_own_lights(spread: float, rise: float, settings: LightingSettings) -> float:
    """Weigh lights of the views' own against one for all: from 0, one light, to 1, each its own.

    Parameters
    ----------
    spread : float
        By which views differ, see `ViewGains`: up to `still_light` one light is taken to serve all, from
        `moving_light` on each has its own, unless they differ as gloss makes them.
    rise : float
        See `brightening`: gloss lifts views above one another further than moving light does.
    settings : LightingSettings
    """
    if settings.lights != "auto":
        return float(settings.lights == "per-view")
    how, still = settings.sharing, settings.still_up_to
    moved = (spread - still) / (settings.moving_light - still)
    not_gloss = (how.glossy_brightening - rise) / (how.glossy_brightening - how.matte_brightening)
    return float(np.clip(moved, 0, 1) * np.clip(not_gloss, 0, 1))


def mixed_with_own_lights(
    shared: Observations,
    apart: Observations,
    scene: LitScene,
    light: LightEstimate,
    step: Callable[[], None],
) -> tuple[Observations, LightEstimate]:
    """Mix one light for all views with lights of their own, by `Observations.apart`.

    Parameters
    ----------
    shared, apart : Observations
        As seen in one light, which may have gloss taken off, and in a light for each view. By the settings
        of the latter its lights are found.
    scene : LitScene
    light : LightEstimate
        The one light.
    step : callable
        Called after every scale of the search.

    Returns
    -------
    tuple of Observations and LightEstimate
        One light for each view, from as far away as the one. Shading is linear in light, so that the shading
        by the mixture is the mixture of both shadings, each of mean 1; of gloss, as much is taken off.
    """
    weight = np.float32(shared.apart)
    own = _of_mean_one(apart, scene, apart.light(scene, step))
    one = _of_mean_one(shared, scene, light)
    found = LightEstimate(
        (1 - weight) * one.radiance + weight * own.radiance, (1 - weight) * one.bounced + weight * own.bounced
    )
    photos = replace(
        apart,
        observed=(1 - weight) * shared.observed + weight * apart.observed,
        diffuse=(1 - weight) * shared.diffuse + weight * apart.diffuse,
        viewing=shared.viewing,
    )
    return photos, found


def _of_mean_one(photos: Observations, scene: LitScene, found: LightEstimate) -> LightEstimate:
    """A light, scaled so that its mean shading is 1 in each channel."""
    mean = photos.shading(scene, found).mean(axis=0, dtype=np.float64)
    mean = np.where(mean > 0, mean, 1)
    return LightEstimate(found.radiance / mean, (found.bounced / mean).astype(np.float32))
