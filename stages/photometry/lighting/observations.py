"""Observations for the light estimation: lights of the views, highlights and specular reflection."""

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
from stages.photometry.specular.chromaticity_clusters import ChromaticityClusters
from stages.photometry.specular.highlights import (
    LinkedPatches,
    brightening,
    darker_outliers,
    without_highlights,
)
from stages.photometry.specular.specular_reflection import (
    GlossyPaints,
    Mirror,
    SpecularReflection,
    highlights_of,
    without_specular,
)
from stages.photometry.specular.view_differences import Differences, InMirror, MirrorStrength
from stages.photometry.stack import StackedViews
from stages.photometry.transport.lit_scenes import LitScene

NEVER = 10.0  # power of `DarkOutlierSettings.ratio` that nothing in a photo reaches


@dataclass(frozen=True, eq=False)
class Observations:
    """Photos as the light is estimated from them: gains of the views divided out.

    Attributes
    ----------
    views : StackedViews
    viewing : Viewing
        At least one pixel is trusted.
    observed : ndarray, shape (N, 3), float32
    diffuse : ndarray, shape (N, 3), float32
        Without highlights, where all views share a light.
    light_of_view : ndarray, shape (n,), int64
        Index of the light of every view.
    brightening : float
        Of the views.
    apart : float
        Weight of per-view lights against a shared one, 0 to 1.
    settings : LightingSettings
        `brightest` is its current estimate; None: the albedo has its own scale.
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
        """Weigh per-view lights by the spread and brightening of the views; nothing is removed yet.

        `linked` contains correspondences of the pixels that `viewing` trusts.
        """
        views = linked.views
        one_light = np.zeros(views.view_count, np.int64)
        rise = brightening(linked, observed)
        apart = weight_of_own_lights(spread, rise, settings) if views.view_count > 1 else 0.0
        return cls(views, viewing, observed, observed, one_light, rise, apart, settings)

    def as_lit(self, linked: LinkedPatches) -> Observations:
        """Assume one light for all views, unless that has no weight."""
        return self.each_in_its_own_light() if self.apart == 1 else self.in_one_light(linked)

    def in_one_light(self, linked: LinkedPatches) -> Observations:
        """Exclude `darker_outliers` and remove highlights.

        The less weight a shared light has, the darker an outlier must be: per-view lights cast shadows, too.
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
        """Assign a light to each view; shadows and highlights of one view cannot be identified then."""
        return replace(self, light_of_view=np.arange(self.views.view_count))

    @property
    def share_a_light(self) -> bool:
        """Whether one light is common to all views, as `light_of_view` has it."""
        return not self.light_of_view.any()

    def reflecting(self, brightest: float) -> Observations:
        """Set the reflectance of the brightest material."""
        return replace(self, settings=self.settings.reflecting(brightest))

    def search(self, scene: LitScene) -> Search:
        """Draw the pixels that the light is estimated from."""
        return Search.of(scene, *self._compared, self.settings)

    def light(
        self, scene: LitScene, step: Callable[[], None], near: LightEstimate | None = None
    ) -> LightEstimate:
        """Estimate the light, starting from `near` if that is given."""
        return estimate_light(scene, *self._compared, self.settings, step, near)

    def disagreements(self, scenes: Sequence[LitScene], lights: Sequence[LightEstimate]) -> list[float]:
        """Compute the loss of pairs of equal albedo under each of several lights."""
        return disagreements(scenes, lights, *self._compared, self.settings)

    @property
    def _compared(self) -> tuple[StackedViews, np.ndarray, np.ndarray, np.ndarray]:
        """Data of the light search: views, image, trusted pixels, lights of the views."""
        return self.views, self.diffuse, self.viewing.trusted, self.light_of_view

    def shading(self, scene: LitScene, found: LightEstimate) -> np.ndarray:
        """Compute the shading of all pixels by a light, (N, 3), float32."""
        return found.shading(scene, self.views.starts, self.light_of_view)

    def differences(self, scene: LitScene, found: LightEstimate) -> Differences:
        """Compute differences between views under a shared light, with the specular lobes there."""
        views, viewing, pixels, how = (
            self.views,
            self.viewing,
            scene.pixels,
            self.settings.specular.differences,
        )

        def shading_at(some: np.ndarray) -> np.ndarray:
            return found.shading_at(scene, some)

        return Differences.of(views, self.observed, viewing.trusted, viewing.towards, pixels, shading_at, how)

    def _initial_specular(
        self, scene: LitScene, differences: Differences, found: LightEstimate
    ) -> tuple[SpecularReflection, Differences] | None:
        """Initialise the reflection, with the view differences of its surface; None if nothing is glossy.

        It covers all surface, if mirrored light explains most of the differences. Else it covers those
        clusters of albedo whose differences are explained by the mirrored estimate from shading.
        """
        mirrored, light = differences.mirrored, found.radiance[0]
        if mirrored and mirrored.explains_most:
            strength = mirrored.radiance.sum(axis=0) / np.maximum(light.sum(axis=0), 1e-12)
            everything = np.ones(len(self.observed), bool)
            return SpecularReflection(strength, mirrored.roughness, mirrored.left, everything), differences
        return self._specular_of_clusters(scene, differences, found)

    def _specular_of_clusters(
        self, scene: LitScene, differences: Differences, found: LightEstimate
    ) -> tuple[SpecularReflection, Differences] | None:
        """Estimate the reflection of the clusters whose differences mirrored light explains; None without."""
        light = found.radiance[0]
        how, shading = self.settings.specular.clusters, self.shading(scene, found)
        clusters, cluster = ChromaticityClusters.of(
            self.views, self.diffuse, shading, self.viewing.trusted, how
        )
        numbers = tuple(
            number
            for number in range(int(cluster.max()) + 1)
            if self._is_specular(differences.within(cluster == number).strength(light))
        )
        if not numbers:
            return None
        glossy = np.isin(cluster, numbers)
        own = differences.within(glossy)
        of_all = own.strength(light)
        if of_all is None:  # impossible: one of the clusters alone has enough correspondences
            return None
        paints = GlossyPaints(clusters, numbers, found)
        return SpecularReflection(of_all.strength, of_all.roughness, of_all.left, glossy, paints), own

    def specular(
        self,
        scene: LitScene,
        found: LightEstimate,
        differences: Differences,
        step: Callable[[], None],
    ) -> tuple[SpecularReflection, LightEstimate] | None:
        """Estimate specular reflection and light jointly; None where nothing is glossy.

        The mirrored light equals that of the shading but for the mirror's strength. View differences alone
        do not determine it, nor do pairs while the images contain specular reflection. Both therefore
        constrain one light, and the reflection that is removed from the photos is recomputed before each
        alternation. Highlights are removed only after the light is estimated: in each alternation that would
        cost more than the alternation itself, and change little.
        """
        initial = self._initial_specular(scene, differences, found)
        if initial is None:
            return None
        specular, own = initial
        mirror = own.in_mirror(specular.roughness)
        specular = self._bounded(specular, mirror, scene, found)
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
            specular = self._bounded(specular, mirror, scene, found)
            step()
        how = self.settings.specular
        most = how.differences.explained_residual if specular.glossy.all() else how.cluster_residual
        return (specular, found) if specular.left < most and self._likely(specular.strength) else None

    def specular_in(self, scene: LitScene, found: LightEstimate) -> SpecularReflection | None:
        """Estimate the reflection of a known light: of all surface, else of some clusters; None without."""
        differences = self.differences(scene, found)
        whole = differences.strength(found.radiance[0])
        how = self.settings.specular
        explained = whole is not None and whole.left < how.differences.explained_residual
        if whole is not None and explained and self._likely(whole.strength):
            everything = np.ones(len(self.observed), bool)
            specular = SpecularReflection(whole.strength, whole.roughness, whole.left, everything)
            specular = self._bounded(specular, differences.in_mirror(whole.roughness), scene, found)
            if specular.left < how.differences.explained_residual and self._likely(specular.strength):
                return specular
        of_clusters = self._specular_of_clusters(scene, differences, found)
        if of_clusters is None:
            return None
        specular, own = of_clusters
        specular = self._bounded(specular, own.in_mirror(specular.roughness), scene, found)
        return specular if specular.left < how.cluster_residual and self._likely(specular.strength) else None

    def _bounded(
        self, specular: SpecularReflection, mirror: InMirror, scene: LitScene, found: LightEstimate
    ) -> SpecularReflection:
        """Lower the strength to what the photos show; the mirror tells what that leaves unexplained."""
        seen = self.observed, self.viewing.trusted
        bounded = specular.bounded(*seen, self.mirror(scene, found), self.settings.specular)
        if bounded is specular:
            return specular
        return replace(bounded, left=mirror.left(bounded.strength * found.radiance[0])[0])

    def without_specular(self, specular: SpecularReflection, mirror: Mirror) -> Observations:
        """Remove the reflection; pixels that it dominates in one view but not in another are distrusted."""
        how = self.settings.specular
        observed, share = without_specular(self.observed, specular.image(mirror), how)
        viewing = self.viewing.without(highlights_of(self.views, share, self.viewing.trusted, how))
        return replace(
            self, viewing=viewing, observed=observed, diffuse=self._without_highlights(viewing, observed)
        )

    def mirror(self, scene: LitScene, found: LightEstimate) -> Mirror:
        """Build the mirror image of the shared light."""
        return Mirror(scene.pixels, found.radiance[0], self.viewing.towards)

    def _is_specular(self, fit: MirrorStrength | None) -> bool:
        """Decide whether a cluster of albedo is specular."""
        return (
            fit is not None
            and fit.left < self.settings.specular.cluster_residual
            and self._likely(fit.strength)
        )

    def _likely(self, strength: np.ndarray) -> bool:
        how = self.settings.specular
        return bool(how.min_strength < strength.max() < how.max_strength)
