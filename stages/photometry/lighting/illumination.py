"""The light that the photos were taken in, and what each of their pixels is worth under it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stages.photometry.albedo_data import AlbedoData
from stages.photometry.light_search.brightest_reflectance import Reflectance, reflectance_of
from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.lighting.observations import Observations
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.lighting.trusted_pixels import Viewing, unlit
from stages.photometry.lighting.view_gains import ViewGains, view_gains
from stages.photometry.specular.highlights import LinkedPatches
from stages.photometry.specular.specular_reflection import SpecularReflection
from stages.photometry.stack import StackedViews
from stages.photometry.transport.lit_scenes import LitScene


@dataclass(frozen=True, eq=False)
class ObservationsWithGains:
    """The photos, and the gains of their views, which are divided out.

    Attributes
    ----------
    as_seen : Observations
    lit : Observations
        Taken for lit by one light: without highlights, and without what darkens one view alone. As seen,
        where each view has its own light.
    gains : ViewGains
    of_pixel : ndarray, shape (N, 3), float32
        Gain of each pixel's view.
    """

    as_seen: Observations
    lit: Observations
    gains: ViewGains
    of_pixel: np.ndarray

    @classmethod
    def of(
        cls, views: StackedViews, images: list[np.ndarray], viewing: Viewing, settings: LightingSettings
    ) -> ObservationsWithGains:
        """Compare the views; if no pixel is trusted, all are. Images: 3 of (N,), scaled."""
        image = np.stack(images, axis=1)
        if not viewing.trusted.any():
            viewing = replace(viewing, trusted=np.ones_like(viewing.trusted))
        gains = view_gains(views, image, viewing.trusted, settings.gains)
        of_pixel = np.repeat(gains.gains, np.diff(views.starts), axis=0).astype(np.float32)
        linked = LinkedPatches.of(views, viewing.trusted, settings.highlights)
        as_seen = Observations.of(linked, viewing, image / of_pixel, gains.spread, settings)
        return cls(as_seen, as_seen.as_lit(linked), gains, of_pixel)


@dataclass(frozen=True, eq=False)
class Explanation:
    """What explains the photos, as far as it is known.

    Attributes
    ----------
    photos : Observations
        What the light is found from: without the specular that is known.
    scene : LitScene
        Under light from the distance that is taken.
    light : LightEstimate
    specular : SpecularReflection or None
    specular_sought : bool
        Whether specular was looked for.
    reflectance : Reflectance or None
        Of the brightest material, where it is found.
    number : int
        Which of the scenes it is.
    disagreements : list of float
        Of all scenes.
    """

    photos: Observations
    scene: LitScene
    light: LightEstimate
    specular: SpecularReflection | None = None
    specular_sought: bool = False
    reflectance: Reflectance | None = None
    number: int = 0
    disagreements: list[float] = field(default_factory=list)

    @property
    def glossy(self) -> float:
        """How far there may be gloss of some paints, 0 to 1: it was found, or could not be looked for."""
        of_paints = not self.specular_sought if self.specular is None else not self.specular.glossy.all()
        return max(float(of_paints), self.photos.apart)  # lights of their own cannot be told from gloss

    def without_specular(self) -> Explanation:
        """Take the specular off the photos, if there is any."""
        if self.specular is None:
            return self
        mirror = self.photos.mirror(self.scene, self.light)
        return replace(self, photos=self.photos.without_specular(self.specular, mirror))

    def shading(self) -> np.ndarray:
        """Of all pixels, gains of the views divided out, (N, 3), float32."""
        return self.photos.shading(self.scene, self.light)


@dataclass(frozen=True, eq=False)
class LightAndShading:
    """The light, (G, M, 3), at least 0, and the shading of all pixels by it, (N, 3), float32."""

    radiance: np.ndarray
    shading: np.ndarray

    @classmethod
    def of_mean_one(cls, radiance: np.ndarray, shading: np.ndarray) -> LightAndShading:
        """Scale the light so that the mean shading, with the gains of the views, is 1 in each channel."""
        mean = shading.mean(axis=0, dtype=np.float64).astype(np.float32)
        mean = np.where(mean > 0, mean, np.float32(1))
        return cls(radiance / mean, shading / mean)


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
        Of all scenes; see `explained_best`.
    gains : ViewGains
    specular : SpecularReflection or None
        That was found and taken off.
    brightening : float
        Of the views, gains divided out, specular and all.
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
        explained: Explanation,
        photos: ObservationsWithGains,
        light: LightAndShading,
        brightest: float,
        turn_deg: float | None = None,
    ) -> Illumination:
        """Complete what explains the photos with what their pixels are worth under the light."""
        own, directions = explained.photos, explained.scene.pixels
        return cls(
            light=light,
            scene=explained.number,
            disagreements=explained.disagreements,
            gains=photos.gains,
            specular=explained.specular,
            brightening=own.brightening,
            light_of_view=own.light_of_view,
            apart=own.apart,
            observations=_albedo_data(explained, photos.of_pixel, light.shading),
            directions=directions.directions,
            cells=directions.cells,
            brightest=brightest,
            turn_deg=turn_deg,
            reflectance=explained.reflectance,
        )


def brightest_of(settings: LightingSettings, reflectance: Reflectance | None) -> float:
    """Reflectance of the brightest material, given or found; 0 where that would be a guess."""
    return settings.brightest or (reflectance.value if reflectance else 0.0)


def reflectance_under(
    explained: Explanation,
    light: Callable[[float, LightEstimate], LightEstimate],
    step: Callable[[], None],
) -> Reflectance:
    """Find the reflectance of the brightest material, from that so far on; `light` as of `reflectance_of`."""
    photos, scene = explained.photos, explained.scene

    def left(lights: Sequence[LightEstimate]) -> list[float]:
        return photos.disagreements([scene] * len(lights), lights)

    how = photos.settings.reflectance
    return reflectance_of(light, left, explained.light, step, photos.settings.brightest or how.usual, how)


def _albedo_data(explained: Explanation, of_pixel: np.ndarray, shading: np.ndarray) -> AlbedoData:
    """What is seen, and counts, under this light, with the gains of the pixels' views."""
    photos = explained.photos
    lit = photos.viewing.without(unlit(shading, photos.settings.trusted_pixels))
    return AlbedoData(photos.observed * of_pixel, photos.diffuse * of_pixel, lit.trusted, explained.glossy)
