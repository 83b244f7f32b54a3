"""Shared and per-view lights: their weights, and the mixture of both."""

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
    """Weigh per-view lights against a shared one: 0 for one light, 1 for a light per view.

    Parameters
    ----------
    spread : float
        Difference between views, see `ViewGains`: up to `still_light` one light is shared, from
        `moving_light` on each view has its own, unless specular reflection explains the difference.
    rise : float
        See `brightening`: specular reflection raises it further than moving light does.
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
    """Mix a shared light with per-view lights, weighted by `Observations.apart`.

    Parameters
    ----------
    shared, apart : Observations
        Under one light, from which specular reflection may be removed, and under a light per view. The
        per-view lights are estimated with the settings of the latter.
    scene : LitScene
    light : LightEstimate
        The shared light.
    step : callable
        Called after every scale of the search.

    Returns
    -------
    tuple of Observations and LightEstimate
        One light per view, at the distance of the shared one. Shading is linear in light, so that the shading
        by the mixture is the mixture of both shadings, each of mean 1. Specular reflection is removed by the
        weight of the shared light.
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
    """Scale a light so that its mean shading is 1 in each channel."""
    mean = photos.shading(scene, found).mean(axis=0, dtype=np.float64)
    mean = np.where(mean > 0, mean, 1)
    return LightEstimate(found.radiance / mean, (found.bounced / mean).astype(np.float32))
