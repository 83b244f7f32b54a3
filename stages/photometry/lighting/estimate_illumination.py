"""Estimation of unknown illumination: radiance, distance, view gains and specular reflection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from stages.photometry.lighting.observations import Observations
from stages.photometry.lighting.settings import LightDistanceSettings, LightingSettings
from stages.photometry.lighting.shared_or_own_lights import mixed_with_own_lights
from stages.photometry.lighting.trusted_pixels import Viewing
from stages.photometry.specular.view_differences import Differences
from stages.photometry.stack import StackedViews
from stages.photometry.sun.cast_shadows import cast_shadows, with_visibility
from stages.photometry.sun.pixel_rays import PixelRays
from stages.photometry.sun.settings import ShadowSettings
from stages.photometry.sun.sun_search import aimed_anew, with_suns
from stages.photometry.transport.lit_scenes import LitScene
from stages.solvers.kernels.threading_layer import use_threads

Step = Callable[[], None]


def find_illumination(
    views: StackedViews,
    images: list[np.ndarray],
    scenes: Sequence[LitScene],
    viewing: Viewing,
    settings: LightingSettings,
    threads: int,
    step: Step,
    known_gains: np.ndarray | None = None,
    exposures: np.ndarray | None = None,
    rays: PixelRays | None = None,
) -> Illumination:
    """Estimate light, its distance, view gains, specular reflection, and the pixels' data for the albedo.

    Parameters
    ----------
    views : StackedViews
        Their basis is not used.
    images : list of 3 ndarray, shape (N,)
        Scaled.
    scenes : sequence of LitScene
        One per distance of the light; the one whose light leaves the least disagreement is chosen.
    viewing : Viewing
        If no pixel is trusted, all are.
    settings : LightingSettings
    threads : int
        Never changes the result.
    step : callable
        Called after every step of the search.
    known_gains : ndarray, shape (n, 3), or None
        Gains of the views, estimated from more views.
    exposures : ndarray, shape (n,), or None
        Of the views, by their photos' EXIF data.
    rays : PixelRays or None
        From the pixels to suns; None: these are not looked for.
    """
    use_threads(threads)
    photos = ObservationsWithGains.of(views, images, viewing, settings, known_gains, exposures)
    far = _from_infinitely_far(photos.lit, scenes[0], step)
    now = _at_best_distance(far, scenes, step).without_specular()
    if now.reflectance is not None and now.light is not far.light:
        now = _with_reflectance(now, step)
    now = _in_finer_directions(now, now.light is not far.light, step)
    if rays is not None and now.photos.share_a_light:
        now = _with_suns(now, rays, step)
        now = _with_cast_shadows(now, rays, step)
    now = _mixed_with_own_lights(_with_brightest(now), photos.as_seen, step)
    light = LightAndShading.of_mean_one(now.light.radiance, now.shading() * photos.of_pixel)
    return Illumination.of(now, photos, light, now.photos.settings.brightest or 0.0)


def explained_best(left: Sequence[float], how: LightDistanceSettings) -> int:
    """Return the index of the least; the first (light from infinity) unless another is clearly better."""
    best = int(np.argmin(left))
    return best if left[best] < (1 - how.nearer_gain) * left[0] else 0


def _from_infinitely_far(photos: Observations, scene: LitScene, step: Step) -> Explanation:
    """Estimate light from infinity, and first what the brightest material reflects.

    Beside interreflection that photos of all surface show, that follows from the light instead.
    """
    if scene.shown is not None or not photos.settings.reflectance_is_found:
        return Explanation(photos, scene, photos.light(scene, step))
    photos = photos.reflecting(photos.settings.initial_brightest)
    now = _with_reflectance(Explanation(photos, scene, photos.light(scene, step)), step)
    return replace(now, light=now.photos.light(scene, _unnoticed, near=now.light))


def _with_reflectance(now: Explanation, step: Step) -> Explanation:
    """Estimate the reflectance of the brightest material, and the light near it from fewer pixels."""
    roughly = now.photos.settings.to_compare_reflectances()
    search = replace(now.photos, settings=roughly).search(now.scene)

    def light(brightest: float, near: LightEstimate) -> LightEstimate:
        return replace(search, settings=roughly.reflecting(brightest)).light(_unnoticed, near)

    found = reflectance_under(now, light, step)
    return replace(now, photos=now.photos.reflecting(found.value), light=found.light, reflectance=found)


def _at_best_distance(far: Explanation, scenes: Sequence[LitScene], step: Step) -> Explanation:
    """Choose the distance of the light; estimate specular reflection and light jointly there.

    The specular reflection is not yet removed from the photos.
    """
    now, differences = _best_explanation(far, scenes, step)
    if differences is None:
        return now
    found = now.photos.specular(now.scene, now.light, differences, step)
    specular, light = found or (None, now.light)
    return replace(now, light=light, specular=specular, specular_estimated=True)


def _best_explanation(
    far: Explanation, scenes: Sequence[LitScene], step: Step
) -> tuple[Explanation, Differences | None]:
    """Choose the scene whose light explains the photos best, with the view differences under that light.

    The differences are None where specular reflection is not estimated. Where a near light leads, all are
    compared again in finer directions: a sun between the sampled directions has the shadows of several cells,
    which those of a near light may resemble more.
    """
    lights = [far.light, *(_light_by_as_many_descents(far, scene, step) for scene in scenes[1:])]
    left, differences = _disagreements(far.photos, scenes, lights)
    if explained_best(left, far.photos.settings.distance):
        left, _ = _disagreements(far.photos, *_all_in_finer_directions(far.photos, scenes, lights, step))
    best = explained_best(left, far.photos.settings.distance)
    now = replace(far, scene=scenes[best], light=lights[best], number=best, disagreements=left)
    return now, differences[best] if differences else None


def _disagreements(
    photos: Observations, scenes: Sequence[LitScene], lights: Sequence[LightEstimate]
) -> tuple[list[float], list[Differences]]:
    """Compute what each light leaves unexplained, and the view differences under it.

    The criterion is the loss of pairs of equal albedo, which depends on the shading. Highlights constrain
    light directions more sharply: where every scene has enough view differences, the loss is multiplied by
    the share of them that the light in the mirror leaves. There are no differences where specular reflection
    is not estimated.
    """
    left = photos.disagreements(scenes, lights)
    if not (photos.settings.specular.remove and photos.share_a_light):
        return left, []
    differences = [photos.differences(*each) for each in zip(scenes, lights, strict=True)]
    return _times_specular_residual(left, differences), differences


def _all_in_finer_directions(
    photos: Observations, scenes: Sequence[LitScene], lights: Sequence[LightEstimate], step: Step
) -> tuple[list[LitScene], list[LightEstimate]]:
    """Subdivide the bright cells of each light, and re-estimate it in its scene."""
    finer = [divided(*each, photos.settings.refinement) for each in zip(scenes, lights, strict=True)]
    return [scene for scene, _ in finer], [photos.light(scene, step, near=near) for scene, near in finer]


def _light_by_as_many_descents(far: Explanation, scene: LitScene, step: Step) -> LightEstimate:
    """Estimate the light of a scene, continued as often as that from infinity was for the reflectance."""
    search = far.photos.search(scene)
    light = search.light(step)
    return light if far.reflectance is None else search.light(_unnoticed, near=light)


def _times_specular_residual(left: list[float], differences: list[Differences]) -> list[float]:
    """Multiply disagreements by the specular residuals, if all exist and one light explains most."""
    mirrored = [light for each in differences if (light := each.mirrored) is not None]
    if len(mirrored) < len(left) or not any(light.explains_most for light in mirrored):
        return left
    return [one * min(light.left, 1.0) for one, light in zip(left, mirrored, strict=True)]


def _in_finer_directions(now: Explanation, changed: bool, step: Step) -> Explanation:
    """Subdivide the bright cells of the light and re-estimate it, unless nothing has changed."""
    finer, near = divided(now.scene, now.light, now.photos.settings.refinement)
    if not changed and finer is now.scene:
        return now
    return replace(now, scene=finer, light=now.photos.light(finer, step, near=near))


def _with_suns(now: Explanation, rays: PixelRays, step: Step) -> Explanation:
    """Replace bright cells by suns where that explains the photos better."""
    scene, light = with_suns(now.scene, now.light, now.photos, rays, _unnoticed)
    step()
    return replace(now, scene=scene, light=light)


def _with_cast_shadows(now: Explanation, rays: PixelRays, step: Step) -> Explanation:
    """Hide the suns where the photos are in shadow; find shadows, light and directions in turn."""
    how, by_mesh = rays.how.shadows, now.scene
    if how.find and len(by_mesh.suns):
        for rounds_left in reversed(range(how.rounds)):
            now, hidden = _as_shadowed(now, by_mesh, how.roughly())
            now = replace(now, light=now.photos.light(now.scene, _unnoticed, near=now.light))
            if rounds_left:
                by_mesh, light = aimed_anew(by_mesh, now.light, now.photos, rays, hidden)
                now = replace(now, light=light)
        now, _ = _as_shadowed(now, by_mesh, how)
    step()
    return now


def _as_shadowed(now: Explanation, by_mesh: LitScene, how: ShadowSettings) -> tuple[Explanation, np.ndarray]:
    """Find the shadows under the current light; returns also what `cast_shadows` finds hidden."""
    photos, shading = now.photos, now.photos.shading(by_mesh, now.light)
    seen = photos.diffuse, photos.viewing.trusted, photos.views.masks, photos.views.side
    by_photo, hidden = cast_shadows(by_mesh, now.light, shading, *seen, photos.settings.pairs, how)
    scene = with_visibility(by_mesh, by_photo)
    return replace(now, scene=scene, shadowed=np.any(hidden, axis=1)), hidden


def _with_brightest(now: Explanation) -> Explanation:
    """Compute what the brightest material reflects, where that was neither given nor found first."""
    if not now.photos.settings.reflectance_is_found:
        return now
    return replace(now, photos=now.photos.reflecting(now.photos.search(now.scene).brightest(now.light)))


def _mixed_with_own_lights(now: Explanation, as_seen: Observations, step: Step) -> Explanation:
    """Mix the shared light with per-view lights, by the weight of the latter."""
    apart = now.photos.apart
    if not 0 < apart < 1:
        return now
    own = replace(as_seen, settings=now.photos.settings).each_in_its_own_light()
    photos, light = mixed_with_own_lights(now.photos, own, now.scene, now.light, step)
    specular = now.specular and replace(now.specular, strength=(1 - apart) * now.specular.strength)
    return replace(now, photos=photos, light=light, specular=specular)


def _unnoticed() -> None:
    """Ignore a step: its progress is not shown."""
