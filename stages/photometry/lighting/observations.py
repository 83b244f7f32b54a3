"""Photos as light is sought from them: how many lights they were taken in, what in them is gloss."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.light_from_specular import light_in_gloss
from stages.photometry.light_search.search import Search, disagreements, estimate_light
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.lighting.shared_or_own_lights import weight_of_own_lights
from stages.photometry.lighting.trusted_pixels import Viewing
from stages.photometry.specular.chromaticity_clusters import chromaticity_clusters
from stages.photometry.specular.highlights import (
    LinkedPatches,
    brightening,
    darker_outliers,
    without_highlights,
)
from stages.photometry.specular.specular_reflection import (
    Mirror,
    SpecularReflection,
    highlights_of,
    without_specular,
)
from stages.photometry.specular.view_differences import Differences, MirrorStrength
from stages.photometry.stack import StackedViews
from stages.photometry.transport.lit_scenes import LitScene

NEVER = 10.0  # power of `DarkOutlierSettings.ratio` that nothing in a photo reaches


@dataclass(frozen=True, eq=False)
class Observations:
    """The photos as light is sought from them: gains of the views divided out.

    Attributes
    ----------
    views : StackedViews
    looks : Viewing
        At least one is trusted.
    seen : ndarray, shape (N, 3), float32
    diffuse : ndarray, shape (N, 3), float32
        Without highlights, where one light serves all views.
    light_of_view : ndarray, shape (n,), int64
        Which light every view stands in.
    brightening : float
        Of the views.
    apart : float
        How far every view has a light of its own: 0, not at all, to 1.
    settings : LightingSettings
        `brightest` is what is taken for it so far; None: the albedo has its own scale.
    """

    views: StackedViews
    viewing: Viewing
    observed: np.ndarray
    diffuse: np.ndarray
    light_of_view: np.ndarray
    brightening: float
    apart: float
    settings: LightingSettings

    @classmethod
    def of(
        cls,
        linked: LinkedPatches,
        viewing: Viewing,
        observed: np.ndarray,
        spread: float,
        settings: LightingSettings,
    ) -> Observations:
        """Tell how far views with such a spread have lights of their own; nothing is taken off yet.

        `linked`: by the pixels that `viewing` trusts.
        """
        views = linked.views
        one_light = np.zeros(views.view_count, np.int64)
        rise = brightening(linked, observed)
        apart = weight_of_own_lights(spread, rise, settings) if views.view_count > 1 else 0.0
        return cls(views, viewing, observed, observed, one_light, rise, apart, settings)

    def as_lit(self, linked: LinkedPatches) -> Observations:
        """Take the photos for lit by one light, unless that has no weight at all."""
        return self.each_in_its_own_light() if self.apart == 1 else self.in_one_light(linked)

    def in_one_light(self, linked: LinkedPatches) -> Observations:
        """Leave out what `darker_outliers` finds, and take highlights off.

        The less weight one light has, the darker a place must be: lights of their own darken places, too.
        """
        power = min(1 / (1 - self.apart), NEVER)
        viewing = self.viewing.without(
            darker_outliers(linked, self.observed, self.settings.dark_outliers, power)
        )
        return replace(self, viewing=viewing, diffuse=self._without_highlights(viewing, self.observed))

    def _without_highlights(self, viewing: Viewing, observed: np.ndarray) -> np.ndarray:
        how = self.settings.highlights
        return without_highlights(LinkedPatches.of(self.views, viewing.trusted, how), observed, how)

    def each_in_its_own_light(self) -> Observations:
        """Take the photos as they are seen: neither shadows nor highlights can be told."""
        return replace(self, light_of_view=np.arange(self.views.view_count))

    @property
    def share_a_light(self) -> bool:
        """Matt surface then looks the same in all views."""
        return not self.light_of_view.any()

    def reflecting(self, brightest: float) -> Observations:
        """Take the brightest material to reflect so much."""
        return replace(self, settings=self.settings.reflecting(brightest))

    def search(self, scene: LitScene) -> Search:
        """The pixels that light is found from."""
        return Search.of(scene, *self._compared, self.settings)

    def light(
        self, scene: LitScene, step: Callable[[], None], near: LightEstimate | None = None
    ) -> LightEstimate:
        """What they were taken in; one that is `near` it is gone on from."""
        return estimate_light(scene, *self._compared, self.settings, step, near)

    def disagreements(self, scenes: Sequence[LitScene], lights: Sequence[LightEstimate]) -> list[float]:
        """How much each of several lights leaves unexplained."""
        return disagreements(scenes, lights, *self._compared, self.settings)

    @property
    def _compared(self) -> tuple[StackedViews, np.ndarray, np.ndarray, np.ndarray]:
        """What the search for light compares: views, image, trusted pixels, lights of the views."""
        return self.views, self.diffuse, self.viewing.trusted, self.light_of_view

    def shading(self, scene: LitScene, found: LightEstimate) -> np.ndarray:
        """Of all pixels by a light, (N, 3), float32."""
        return found.shading(scene, self.views.starts, self.light_of_view)

    def differences(self, scene: LitScene, found: LightEstimate) -> Differences:
        """How views differ under the one light found, and how mirrors would make them differ."""
        views, viewing, pixels, how = (
            self.views,
            self.viewing,
            scene.pixels,
            self.settings.specular.differences,
        )

        def shading_at(some: np.ndarray) -> np.ndarray:
            return found.shading_at(scene, some)

        return Differences.of(views, self.observed, viewing.trusted, viewing.towards, pixels, shading_at, how)

    def gloss(
        self, scene: LitScene, differences: Differences, found: LightEstimate
    ) -> tuple[SpecularReflection, Differences] | None:
        """A first guess at the reflection, and how views of what has it differ; None where nothing is glossy.

        Of all surface, if light in a mirror explains most of the differences; else of those clusters of
        albedo whose differences the light found explains in a mirror, though it is known by shading alone.
        """
        mirrored, light = differences.mirrored, found.radiance[0]
        if mirrored and mirrored.explains_most:
            strength = mirrored.radiance.sum(axis=0) / np.maximum(light.sum(axis=0), 1e-12)
            everything = np.ones(len(self.observed), bool)
            return SpecularReflection(strength, mirrored.roughness, mirrored.left, everything), differences
        return self._gloss_of_paints(scene, differences, found)

    def _gloss_of_paints(
        self, scene: LitScene, differences: Differences, found: LightEstimate
    ) -> tuple[SpecularReflection, Differences] | None:
        """The reflection of those clusters whose differences light in a mirror explains; None if of none."""
        light = found.radiance[0]
        how, shading = self.settings.specular.clusters, self.shading(scene, found)
        paint = chromaticity_clusters(self.views, self.diffuse, shading, self.viewing.trusted, how)
        of_paint = (paint == number for number in range(int(paint.max()) + 1))
        shown = [own for own in of_paint if self._shows(differences.within(own).strength(light))]
        if not shown:
            return None
        glossy = np.any(shown, axis=0)
        own = differences.within(glossy)
        of_all = own.strength(light)
        if of_all is None:  # cannot be: one of the paints alone has links enough
            return None
        return SpecularReflection(of_all.strength, of_all.roughness, of_all.left, glossy), own

    def specular(
        self,
        scene: LitScene,
        found: LightEstimate,
        differences: Differences,
        step: Callable[[], None],
    ) -> tuple[SpecularReflection, LightEstimate] | None:
        """Find specular reflection and the light at once; None where nothing is glossy.

        The mirror's light and that on the paint are one but for the mirror's strength. Differences alone do
        not tell all of it, nor do pairs while gloss is in what is seen; so they look for it together, and
        what the reflection takes off the photos is found anew before each turn. Highlights are not compared
        until the light is known: that costs more than a turn, and changes little.
        """
        gloss = self.gloss(scene, differences, found)
        if gloss is None:
            return None
        specular, own = gloss
        mirror = own.in_mirror(specular.roughness)
        for _ in range(self.settings.specular.alternations):
            diffuse, _ = without_specular(
                self.observed, specular.image(self.mirror(scene, found)), self.settings.specular
            )
            search = replace(self, diffuse=diffuse).search(scene)
            objective, start = search.objective(found), found.radiance
            light = light_in_gloss(objective, mirror, specular.strength, start, self.settings)
            left, _ = mirror.left(specular.strength * light[0])
            settled = search.settled(light, found)
            dimmed = light.sum() / max(settled.radiance.sum(), 1e-12)
            specular, found = replace(specular, strength=specular.strength * dimmed, left=left), settled
            step()
        how = self.settings.specular
        most = how.differences.explained_residual if specular.glossy.all() else how.cluster_residual
        return (specular, found) if specular.left < most and self._likely(specular.strength) else None

    def specular_in(self, scene: LitScene, found: LightEstimate) -> SpecularReflection | None:
        """Find the reflection of a known light: of all surface, else of some clusters; None if of none."""
        differences = self.differences(scene, found)
        whole = differences.strength(found.radiance[0])
        how = self.settings.specular
        explained = whole is not None and whole.left < how.differences.explained_residual
        if whole is not None and explained and self._likely(whole.strength):
            return SpecularReflection(
                whole.strength, whole.roughness, whole.left, np.ones(len(self.observed), bool)
            )
        gloss = self._gloss_of_paints(scene, differences, found)
        if gloss is None:
            return None
        specular, _ = gloss
        return specular if specular.left < how.cluster_residual and self._likely(specular.strength) else None

    def without_specular(self, specular: SpecularReflection, mirror: Mirror) -> Observations:
        """The photos without it; what it hides in one view and not in another is no longer trusted."""
        how = self.settings.specular
        observed, share = without_specular(self.observed, specular.image(mirror), how)
        viewing = self.viewing.without(highlights_of(self.views, share, self.viewing.trusted, how))
        return replace(
            self, viewing=viewing, observed=observed, diffuse=self._without_highlights(viewing, observed)
        )

    def mirror(self, scene: LitScene, found: LightEstimate) -> Mirror:
        """What the one light found would show in the surface."""
        return Mirror(scene.pixels, found.radiance[0], self.viewing.towards)

    def _shows(self, fit: MirrorStrength | None) -> bool:
        """Whether a cluster of albedo is specular."""
        return (
            fit is not None
            and fit.left < self.settings.specular.cluster_residual
            and self._likely(fit.strength)
        )

    def _likely(self, strength: np.ndarray) -> bool:
        how = self.settings.specular
        return bool(how.min_strength < strength.max() < how.max_strength)
