"""Estimation under a known light: its yaw, view gains and specular reflection."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stages.photometry.light_search.direction_refinement import divided
from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.lighting.illumination import (
    Explanation,
    Illumination,
    LightAndShading,
    ObservationsWithGains,
    reflectance_under,
)
from stages.photometry.lighting.known_light import KnownLight, light_at, turn_of
from stages.photometry.lighting.observations import Observations
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.lighting.trusted_pixels import Viewing
from stages.photometry.stack import StackedViews
from stages.photometry.transport.lit_scenes import LitScene
from stages.solvers.kernels.threading_layer import use_threads


def illumination_by(
    known: KnownLight,
    views: StackedViews,
    images: list[np.ndarray],
    scene: LitScene,
    viewing: Viewing,
    settings: LightingSettings,
    threads: int,
    step: Callable[[], None],
    exposures: np.ndarray | None = None,
) -> Illumination:
    """Estimate yaw, view gains, specular reflection and the pixels' data under a known light.

    Parameters as of `find_illumination`; the light comes from infinity and is one for all views.
    """
    use_threads(threads)
    photos = ObservationsWithGains.of(
        views, images, viewing, settings.model_copy(update={"lights": "shared"}), exposures=exposures
    )
    lit = _with_scale_of(known, photos.lit)
    search = lit.search(scene)
    turn_deg = turn_of(search, known, settings.known_light, step)
    turned = Explanation(lit, scene, light_at(search, known, turn_deg))
    now = _with_specular(turned).without_specular()
    if known.scale is None and settings.reflectance_is_found:
        now = _with_reflectance(now, known, turn_deg, step)
    now = _in_finer_directions(now, known, turn_deg, now.photos is not lit)
    step()
    now = replace(now, disagreements=now.photos.disagreements([now.scene], [now.light]))
    asked = settings.brightest or (now.reflectance.value if now.reflectance else 0.0)
    brightest = asked if known.scale is None else 0.0
    return Illumination.of(now, photos, _in_unit_of(known, now, photos.of_pixel), brightest, turn_deg)


def _with_scale_of(known: KnownLight, photos: Observations) -> Observations:
    """Leave the scale of the albedo free (absolute), where the unit of the light is known."""
    if known.scale is None:
        return replace(photos, settings=photos.settings.to_begin_with())
    return replace(photos, settings=photos.settings.model_copy(update={"brightest": None}))


def _with_specular(now: Explanation) -> Explanation:
    """Estimate specular reflection under the light, if requested, without removing it from the photos."""
    if not now.photos.settings.specular.remove:
        return now
    return replace(now, specular=now.photos.specular_in(now.scene, now.light), specular_estimated=True)


def _with_reflectance(
    now: Explanation, known: KnownLight, turn_deg: float, step: Callable[[], None]
) -> Explanation:
    """Estimate the reflectance of the brightest material; the light is updated with its finer directions."""
    search, how = now.photos.search(now.scene), now.photos.settings

    def light(brightest: float, _: LightEstimate) -> LightEstimate:
        return light_at(replace(search, settings=how.reflecting(brightest)), known, turn_deg)

    found = reflectance_under(now, light, step)
    return replace(now, photos=now.photos.reflecting(found.value), reflectance=found)


def _in_finer_directions(now: Explanation, known: KnownLight, turn_deg: float, changed: bool) -> Explanation:
    """Subdivide the bright cells and resample the picture in them, unless nothing has changed."""
    finer, _ = divided(now.scene, now.light, now.photos.settings.refinement)
    if not changed and finer is now.scene:
        return now
    return replace(now, scene=finer, light=light_at(now.photos.search(finer), known, turn_deg))


def _in_unit_of(known: KnownLight, now: Explanation, of_pixel: np.ndarray) -> LightAndShading:
    """Express the light in its own unit, where that is known; else normalise mean shading to 1."""
    radiance, shading = now.light.radiance, now.shading() * of_pixel
    if known.scale is None:
        return LightAndShading.of_mean_one(radiance, shading)
    unit = np.full(3, known.scale, np.float32)
    return LightAndShading(radiance / unit, shading / unit, unit)
