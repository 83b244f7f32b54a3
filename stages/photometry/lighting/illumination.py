"""Estimated illumination, and the data of each pixel for the albedo under it."""

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
from stages.photometry.stack import StackedViews, stack_views
from stages.photometry.transport.lit_scenes import LitScene


@dataclass(frozen=True, eq=False)
class ObservationsWithGains:
    """Photos with the gains of their views divided out.

    Attributes
    ----------
    as_seen : Observations
    lit : Observations
        Under the assumption of one light: without highlights, and without pixels that are dark in one view
        alone. Equal to `as_seen` but for its lights, where each view has its own.
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
        cls,
        views: StackedViews,
        images: list[np.ndarray],
        viewing: Viewing,
        settings: LightingSettings,
        known_gains: np.ndarray | None = None,
        exposures: np.ndarray | None = None,
    ) -> ObservationsWithGains:
        """Divide known or estimated gains out of scaled images, 3 of (N,). If no pixel is trusted: all."""
        image = np.stack(images, axis=1)
        if not viewing.trusted.any():
            viewing = replace(viewing, trusted=np.ones_like(viewing.trusted))
        gains = view_gains(views, image, viewing.trusted, settings.gains, known_gains, exposures)
        of_pixel = np.repeat(gains.gains, np.diff(views.starts), axis=0).astype(np.float32)
        linked = LinkedPatches.of(views, viewing.trusted, settings.highlights)
        as_seen = Observations.of(linked, viewing, image / of_pixel, gains.spread, settings)
        return cls(as_seen, as_seen.as_lit(linked), gains, of_pixel)


@dataclass(frozen=True, eq=False)
class Explanation:
    """Current estimate of what explains the photos.

    Attributes
    ----------
    photos : Observations
        Data of the light estimation, without specular reflection once that is removed.
    scene : LitScene
        Under light from the chosen distance.
    light : LightEstimate
    specular : SpecularReflection or None
    specular_estimated : bool
        Whether an estimation of specular reflection was made, with or without result.
    reflectance : Reflectance or None
        Of the brightest material, where it is estimated.
    number : int
        Index of the scene.
    disagreements : list of float
        One per scene.
    removed_under : tuple of LitScene and LightEstimate, or None
        Scene and light of the reflection that was removed from the photos.
    shadowed : ndarray, shape (N,), bool, or None
        Pixels in the shadow of what the mesh does not have; None: not looked for.
    """

    photos: Observations
    scene: LitScene
    light: LightEstimate
    specular: SpecularReflection | None = None
    specular_estimated: bool = False
    reflectance: Reflectance | None = None
    number: int = 0
    disagreements: list[float] = field(default_factory=list)
    removed_under: tuple[LitScene, LightEstimate] | None = None
    shadowed: np.ndarray | None = None

    @property
    def glossy(self) -> float:
        """Weight, 0 to 1, of specular reflection on some materials: it was found, or never estimated."""
        on_some = not self.specular_estimated if self.specular is None else not self.specular.glossy.all()
        return max(float(on_some), self.photos.apart)  # per-view lights cannot be distinguished from gloss

    def without_specular(self) -> Explanation:
        """Remove the specular reflection from the photos, if there is any."""
        if self.specular is None:
            return self
        mirror = self.photos.mirror(self.scene, self.light)
        photos = self.photos.without_specular(self.specular, mirror)
        return replace(self, photos=photos, removed_under=(self.scene, self.light))

    def shading(self) -> np.ndarray:
        """Compute the shading of all pixels, view gains divided out, (N, 3), float32."""
        return self.photos.shading(self.scene, self.light)


@dataclass(frozen=True, eq=False)
class LightAndShading:
    """Light in its unit.

    Attributes
    ----------
    radiance : ndarray, shape (G, M, 3)
        At least 0.
    shading : ndarray, shape (N, 3), float32
        Of all pixels, view gains included.
    unit : ndarray, shape (3,), float32
        By which light and shading were divided.
    """

    radiance: np.ndarray
    shading: np.ndarray
    unit: np.ndarray

    @classmethod
    def of_mean_one(cls, radiance: np.ndarray, shading: np.ndarray) -> LightAndShading:
        """Normalise the light so that the mean shading, view gains included, is 1 in each channel."""
        mean = shading.mean(axis=0, dtype=np.float64).astype(np.float32)
        mean = np.where(mean > 0, mean, np.float32(1))
        return cls(radiance / mean, shading / mean, mean)


@dataclass(frozen=True, eq=False)
class Illumination:
    """Result of the estimation; pixels as in the stack, images scaled.

    Attributes
    ----------
    light : LightAndShading
        Its shading includes the gains of the views.
    scene : int
        Index of the scene that explains the photos best.
    disagreements : list of float
        One per scene; see `explained_best`.
    gains : ViewGains
    specular : SpecularReflection or None
        Estimated and removed.
    brightening : float
        Of the views, gains divided out, specular reflection included.
    light_of_view : ndarray, shape (n,), int64
    apart : float
        Weight of per-view lights against a shared one, 0 to 1.
    observations : AlbedoData
    typical_shading : float
        Median, gains divided out.
    directions : ndarray, shape (M, 3)
        Of the light.
    cells : ndarray, shape (M,)
        Solid angle of each direction as a share of the sphere.
    turn_deg : float or None
        Yaw of a known light.
    brightest : float
        Reflectance of the brightest material, given or estimated; 0 if neither, or if albedo is absolute.
    reflectance : Reflectance or None
        Record of its estimation, if it was estimated.
    explained : Explanation
        What explains the photos.
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
    typical_shading: float
    directions: np.ndarray
    cells: np.ndarray
    brightest: float
    explained: Explanation
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
        """Combine an explanation with the pixels' data for the albedo under its light."""
        own, directions = explained.photos, explained.scene.pixels
        shading = light.shading / photos.of_pixel
        typical = float(np.median(shading))
        return cls(
            light=light,
            scene=explained.number,
            disagreements=explained.disagreements,
            gains=photos.gains,
            specular=explained.specular,
            brightening=own.brightening,
            light_of_view=own.light_of_view,
            apart=own.apart,
            observations=_albedo_data(explained, photos.of_pixel, shading, typical),
            typical_shading=typical,
            directions=directions.directions,
            cells=directions.cells,
            brightest=brightest,
            explained=explained,
            turn_deg=turn_deg,
            reflectance=explained.reflectance,
        )

    def without_pixels(self) -> Illumination:
        """Drop all that is per pixel: what further views need is kept."""
        none = np.zeros(0, np.int64)
        explained = self.explained
        nothing = np.zeros((0, 3), np.float32)
        photos = replace(
            explained.photos,
            views=stack_views([], None, {}),
            viewing=Viewing(none.astype(bool), nothing, none.astype(bool)),
            observed=nothing,
            diffuse=nothing,
        )
        scene = replace(explained.scene.at(none), probes=None, shown=None)  # the light has them
        removed = explained.removed_under and (
            replace(explained.removed_under[0].at(none), probes=None, shown=None),
            explained.removed_under[1],
        )
        return replace(
            self,
            light=replace(self.light, shading=nothing),
            observations=AlbedoData(
                nothing, nothing, none.astype(bool), none.astype(bool), self.observations.glossy
            ),
            explained=replace(explained, photos=photos, scene=scene, removed_under=removed, shadowed=None),
        )


def reflectance_under(
    explained: Explanation,
    light: Callable[[float, LightEstimate], LightEstimate],
    step: Callable[[], None],
) -> Reflectance:
    """Estimate the reflectance of the brightest material from its current value; see `reflectance_of`."""
    photos, scene = explained.photos, explained.scene

    def left(lights: Sequence[LightEstimate]) -> list[float]:
        return photos.disagreements([scene] * len(lights), lights)

    how = photos.settings
    return reflectance_of(light, left, explained.light, step, how.initial_brightest, how.reflectance)


def _albedo_data(
    explained: Explanation, of_pixel: np.ndarray, shading: np.ndarray, typical: float
) -> AlbedoData:
    """Collect observed and diffuse radiance, view gains included, and the pixels trusted under this light.

    `shading`, (N, 3), of which `typical` is the median, has the gains divided out: a photo that is many stops
    darker is not unlit.
    """
    photos = explained.photos
    lit = photos.viewing.without(unlit(shading, typical, photos.settings.trusted_pixels))
    radiances = photos.observed * of_pixel, photos.diffuse * of_pixel
    return AlbedoData(*radiances, lit.trusted, photos.viewing.clipped, explained.glossy)
