"""The light that the photos were taken in, and what each of their pixels is worth under it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stages.photometry.albedo_data import UNLIT, AlbedoData
from stages.photometry.light_search.brightest_reflectance import FIRST, Reflectance, reflectance_of
from stages.photometry.light_search.direction_refinement import divided
from stages.photometry.light_search.light_estimate import LightEstimate, LightSearchSettings
from stages.photometry.lighting.known_light import KnownLight, light_at, turn_of
from stages.photometry.lighting.observations import Observations, Viewing
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.lighting.shared_or_own_lights import LightSharing, mixed_with_own_lights
from stages.photometry.lighting.view_gains import ViewGains, view_gains
from stages.photometry.specular.highlights import Linked
from stages.photometry.specular.specular_reflection import SpecularReflection
from stages.photometry.specular.view_differences import Differences
from stages.photometry.stack import StackedViews
from stages.photometry.transport.lit_scenes import LitScene
from stages.solvers.kernels.threading_layer import use_threads

FEWER = 3  # times fewer pixels tell the light while reflectances are tried
NEARER = 0.01  # by how much less disagreement light from nearby must leave to be believed in


@dataclass(frozen=True)
class IlluminationSettings:
    """What is asked for.

    Attributes
    ----------
    light : LightSearchSettings
        Its `brightest` is what the brightest material reflects; None: that is found.
    lighting : LightSharing
    stage : LightingSettings
        Those of highlights and specular reflection, as they stand.
    """

    light: LightSearchSettings
    lighting: LightSharing
    stage: LightingSettings

    @property
    def reflectance_is_found(self) -> bool:
        """Without bounces it says nothing."""
        return self.light.brightest is None and self.light.bounces > 0

    def brightest_by(self, found: Reflectance | None) -> float:
        """What the brightest material reflects, given or found; 0 where that would be a guess."""
        return self.light.brightest or (found.value if found else 0.0)

    @property
    def to_begin_with(self) -> LightSearchSettings:
        """Those of the light, until that is known better."""
        return self.light if self.light.brightest is not None else self.reflecting(FIRST)

    def reflecting(self, brightest: float) -> LightSearchSettings:
        """Those of the light, if the brightest material reflects so much."""
        return replace(self.light, brightest=brightest)


@dataclass(frozen=True, eq=False)
class LightAndShading:
    """The light, (G, M, 3), at least 0, and the shading of all pixels by it, (N, 3), float32."""

    radiance: np.ndarray
    shading: np.ndarray


@dataclass(frozen=True, eq=False)
class Illumination:
    """What is found; pixels as in the stack, images scaled.

    Attributes
    ----------
    light : LightAndShading
        Its shading with the gains of the views.
    scene : int
        Which of the scenes explains the photos best.
    disagreements : list of float
        Of all scenes; see `_best_explanation`.
    gains : ViewGains
    specular : SpecularReflection or None
        That was found and taken off.
    brightening : float
        Of the views, gains divided out, specular reflection and all.
    light_of_view : ndarray, shape (n,), int64
    apart : float
        How far the lights of the views are their own, 0 to 1.
    observations : AlbedoData
    directions : ndarray, shape (M, 3)
        Of the light.
    cells : ndarray, shape (M,)
        Share of all directions that each stands for.
    turn_deg : float or None
        By how much a light that is known is turned.
    brightest : float
        What the brightest material reflects, given or found; else 0, and where albedo has its own scale.
    reflectance : Reflectance or None
        How it was found, where it was.
    """

    light: LightAndShading
    scene: int
    disagreements: list[float]
    gains: ViewGains
    specular: SpecularReflection | None
    brightening: float
    light_of_view: np.ndarray
    apart: float
    observations: AlbedoData
    directions: np.ndarray
    cells: np.ndarray
    brightest: float
    turn_deg: float | None = None
    reflectance: Reflectance | None = None

    @classmethod
    def of(
        cls,
        photos: Observations,
        looked_at: LitScene,
        light: LightAndShading,
        of_pixel: np.ndarray,
        glossy: float,
        **found: Any,
    ) -> Illumination:
        """Complete what was found by what photos, with the gains of their pixels, (N, 3), and a scene say."""
        return cls(
            light=light,
            brightening=photos.brightening,
            light_of_view=photos.light_of_view,
            apart=photos.apart,
            observations=_observations(photos, light.shading, of_pixel, glossy),
            directions=looked_at.pixels.directions,
            cells=looked_at.pixels.cells,
            **found,
        )


def find_illumination(
    views: StackedViews,
    images: list[np.ndarray],
    scenes: Sequence[LitScene],
    looks: Viewing,
    settings: IlluminationSettings,
    threads: int,
    step: Callable[[], None],
) -> Illumination:
    """Find the light, its distance, the gains of the views, their gloss, and what their pixels are worth.

    Parameters
    ----------
    views : StackedViews
        Their basis is not looked at.
    images : list of 3 ndarray, shape (N,)
        Scaled.
    scenes : sequence of LitScene
        The same under light from other distances: that whose light leaves the least disagreement is taken.
    looks : Viewing
        If none is trusted, all are.
    settings : IlluminationSettings
    threads : int
        Never changes the result.
    step : callable
        Called after every step of the search.
    """
    use_threads(threads)
    as_seen, photos, gains, of_pixel = _photos(views, images, looks, settings.lighting, settings.stage)
    reflectance = None
    how = settings.to_begin_with
    far = photos.light(scenes[0], how, step)
    if settings.reflectance_is_found:
        anew = _sought_anew(photos, scenes[0], how)
        reflectance = _reflectance(photos, scenes[0], far, how, anew, step)
        how = settings.reflecting(reflectance.value)
        far = photos.light(scenes[0], how, lambda: None, near=reflectance.light)
    best, left, found, differences = _best_explanation(
        photos, scenes, far, how, settings.stage.specular.remove, reflectance is not None, step
    )
    scene = scenes[best]
    specular = None
    if differences is not None:
        specular, found = photos.specular(scene, found, differences, how, step) or (None, found)
    glossy = float(differences is None if specular is None else not specular.glossy.all())
    del differences  # many lobes
    if specular is not None:
        photos = photos.without_specular(specular, photos.mirror(scene, found))
    if reflectance is not None and (best != 0 or specular is not None):
        anew = _sought_anew(photos, scene, how)
        reflectance = _reflectance(photos, scene, found, how, anew, step)
        how, found = settings.reflecting(reflectance.value), reflectance.light
    finer, near = divided(scene, found)
    if found is not far or specular is not None or finer is not scene:
        scene, found = finer, photos.light(finer, how, step, near=near)
    if 0 < photos.apart < 1:
        own = as_seen.each_in_its_own_light()
        photos, found = mixed_with_own_lights(photos, own, scene, found, how, step)
        specular = specular and replace(specular, strength=(1 - photos.apart) * specular.strength)
    light = _scaled(found.radiance, photos.shading(scene, found) * of_pixel)
    return Illumination.of(
        photos,
        scene,
        light,
        of_pixel,
        max(glossy, photos.apart),  # lights of their own cannot be told from gloss
        scene=best,
        disagreements=left,
        gains=gains,
        specular=specular,
        brightest=settings.brightest_by(reflectance),
        reflectance=reflectance,
    )


def illumination_by(
    known: KnownLight,
    views: StackedViews,
    images: list[np.ndarray],
    scene: LitScene,
    looks: Viewing,
    settings: IlluminationSettings,
    threads: int,
    step: Callable[[], None],
) -> Illumination:
    """Find all but the light, which is known: its turn, gains of the views, their gloss, the pixels' worth.

    Parameters as of `find_illumination`; the light comes from infinitely far away, one for all views.
    """
    use_threads(threads)
    in_one_light = replace(settings.lighting, asked="shared")
    _, photos, gains, of_pixel = _photos(views, images, looks, in_one_light, settings.stage)
    how = settings.to_begin_with if known.scale is None else replace(settings.light, brightest=None)
    search = photos.search(scene, how)
    turn_deg = turn_of(search, known, step)
    found = light_at(search, known, turn_deg)
    specular = photos.specular_in(scene, found) if settings.stage.specular.remove else None
    if specular is not None:
        photos = photos.without_specular(specular, photos.mirror(scene, found))
    finer, _ = divided(scene, found)
    reflectance = None
    if known.scale is None and settings.reflectance_is_found:
        search = photos.search(scene, how)

        def under(brightest: float, _: LightEstimate) -> LightEstimate:
            return light_at(replace(search, settings=settings.reflecting(brightest)), known, turn_deg)

        reflectance = _reflectance(photos, scene, found, how, under, step)
        how = settings.reflecting(reflectance.value)
    if reflectance is not None or specular is not None or finer is not scene:
        scene, found = finer, light_at(photos.search(finer, how), known, turn_deg)
    step()
    shading = photos.shading(scene, found)
    if known.scale is None:
        light = _scaled(found.radiance, shading * of_pixel)
    else:
        unit = np.float32(known.scale)
        light = LightAndShading(found.radiance / unit, shading * of_pixel / unit)
    glossy = float(not settings.stage.specular.remove if specular is None else not specular.glossy.all())
    return Illumination.of(
        photos,
        scene,
        light,
        of_pixel,
        glossy,
        scene=0,
        disagreements=photos.disagreements([scene], [found], how),
        gains=gains,
        specular=specular,
        brightest=settings.brightest_by(reflectance) if known.scale is None else 0.0,
        turn_deg=turn_deg,
        reflectance=reflectance,
    )


def _photos(
    views: StackedViews,
    images: list[np.ndarray],
    looks: Viewing,
    lighting: LightSharing,
    settings: LightingSettings,
) -> tuple[Observations, Observations, ViewGains, np.ndarray]:
    """The photos as they are seen, and as they are lit, the gains of views, and of all pixels, (N, 3)."""
    image = np.stack(images, axis=1)
    if not looks.trusted.any():
        looks = replace(looks, trusted=np.ones_like(looks.trusted))
    gains = view_gains(views, image, looks.trusted)
    of_pixel = np.repeat(gains.gains, np.diff(views.starts), axis=0).astype(np.float32)
    linked = Linked.of(views, looks.trusted, settings.highlights)
    as_seen = Observations.of(linked, looks, image / of_pixel, gains.spread, lighting, settings)
    return as_seen, as_seen.as_lit(linked), gains, of_pixel


def _best_explanation(
    photos: Observations,
    scenes: Sequence[LitScene],
    far: LightEstimate,
    how: LightSearchSettings,
    specular: bool,
    gone_on: bool,
    step: Callable[[], None],
) -> tuple[int, list[float], LightEstimate, Differences | None]:
    """Which scene it is, what each leaves unexplained, and of that one the light and how views then differ.

    `far`: the light of the first. No differences where no specular reflection is sought.

    What pairs of like paint disagree by is told by the shading; how views differ, by highlights, which are a
    sharper witness of where light comes from, where there are some, and enough in every scene to tell. The
    two are multiplied.
    """

    def as_long_sought(scene: LitScene) -> LightEstimate:
        """As `far` was, if that was gone on from to find what surface reflects."""
        search = photos.search(scene, how)
        light = search.light(step)
        return search.light(lambda: None, near=light) if gone_on else light

    lights = [far, *map(as_long_sought, scenes[1:])]
    left = photos.disagreements(scenes, lights, how)
    if not (specular and photos.share_a_light):
        best = explained_best(left)
        return best, left, lights[best], None
    differences = [photos.differences(*each) for each in zip(scenes, lights, strict=True)]
    mirrored = [light for each in differences if (light := each.mirrored) is not None]
    if len(mirrored) == len(left) and any(light.explains_most for light in mirrored):
        left = [one * min(light.left, 1.0) for one, light in zip(left, mirrored, strict=True)]
    best = explained_best(left)
    return best, left, lights[best], differences[best]


def _reflectance(
    photos: Observations,
    scene: LitScene,
    near: LightEstimate,
    how: LightSearchSettings,
    light: Callable[[float, LightEstimate], LightEstimate],
    step: Callable[[], None],
) -> Reflectance:
    """Find what the brightest material reflects, from that so far on; `light` as of `reflectance_of`."""

    def left(lights: Sequence[LightEstimate]) -> list[float]:
        return photos.disagreements([scene] * len(lights), lights, how)

    first = FIRST if how.brightest is None else how.brightest
    return reflectance_of(light, left, near, step, first)


def _sought_anew(
    photos: Observations, scene: LitScene, how: LightSearchSettings
) -> Callable[[float, LightEstimate], LightEstimate]:
    """Make the search for the light under a reflectance, from a light that is near, by fewer pixels."""
    roughly = replace(how, samples=how.samples // FEWER, scales=how.scales[-1:])
    search = photos.search(scene, roughly)
    return lambda brightest, near: replace(search, settings=replace(roughly, brightest=brightest)).light(
        lambda: None, near
    )


def _observations(
    photos: Observations, shading: np.ndarray, of_pixel: np.ndarray, glossy: float
) -> AlbedoData:
    """What is seen, and counts, under this light, with the gains of the pixels' views."""
    lit = photos.looks.without(shading.mean(axis=1) <= UNLIT * np.median(shading))
    return AlbedoData(photos.seen * of_pixel, photos.diffuse * of_pixel, lit.trusted, glossy)


def explained_best(left: Sequence[float]) -> int:
    """Index of the least; the first, light from far away, unless another is clearly better."""
    best = int(np.argmin(left))
    return best if left[best] < (1 - NEARER) * left[0] else 0


def _scaled(radiance: np.ndarray, shading: np.ndarray) -> LightAndShading:
    """Scale the light so that the mean shading, (N, 3), with the gains of the views, is 1 in each channel."""
    mean = shading.mean(axis=0, dtype=np.float64).astype(np.float32)
    mean = np.where(mean > 0, mean, np.float32(1))
    return LightAndShading(radiance / mean, shading / mean)
