"""Estimation of light from all around and its interreflection, by pairs of equal albedo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.light_from_pairs import (
    PairLoss,
    PairObjective,
    Sample,
    light_from_pairs,
    weighted_by_reliability,
)
from stages.photometry.light_search.pair_sampling import Pairs, PixelSample
from stages.photometry.light_search.settings import LightSearchSettings
from stages.photometry.light_search.vertex_albedo import (
    NO_LIGHT,
    bounced_at_vertices,
    brightest_albedo,
    vertex_albedo,
)
from stages.photometry.stack import StackedViews
from stages.photometry.transport.lit_scenes import LitScene
from stages.photometry.transport.pixel_transfer import WHITEST
from stages.photometry.transport.shown_radiance import ShownRadiance
from stages.solvers.kernels.sparse_rows import product


@dataclass(frozen=True, eq=False)
class Search:
    """Light search on a sample of a scene: paired pixels for the light, further ones for interreflection.

    Attributes
    ----------
    part : LitScene
        With `bounce_pixels` at most.
    starts : ndarray, shape (n + 1,)
        First pixel of every view among these.
    image : ndarray, shape (m, 3)
        Of these pixels.
    light_of_view : ndarray, shape (n,), int64
    drawn : PixelSample
        Paired pixels.
    among : ndarray
        Their indices in `part`.
    sample : Sample
        Of the paired pixels.
    settings : LightSearchSettings
    rng : numpy.random.Generator
    """

    part: LitScene
    starts: np.ndarray
    image: np.ndarray
    light_of_view: np.ndarray
    drawn: PixelSample
    among: np.ndarray
    sample: Sample
    settings: LightSearchSettings
    rng: np.random.Generator

    @classmethod
    def of(
        cls,
        scene: LitScene,
        views: StackedViews,
        image: np.ndarray,
        trusted: np.ndarray,
        light_of_view: np.ndarray,
        settings: LightSearchSettings,
    ) -> Search:
        """Draw the pixels; arguments as of `estimate_light`."""
        how, further = settings.search, int(light_of_view.max(initial=0))
        rng = np.random.default_rng(how.seed)
        chosen = np.flatnonzero(trusted)
        chosen = np.sort(rng.choice(chosen, min(how.bounce_pixels, chosen.size), replace=False))
        part, starts = scene.at(chosen), np.searchsorted(chosen, views.starts)
        count = int(settings.samples * (1 + how.further_light_share * further))
        drawn = PixelSample.of(views, scene.places, chosen, count, rng, settings.pairs)
        among = np.searchsorted(chosen, drawn.pixels)
        own_image = image[drawn.pixels].astype(np.float64)
        shares = part.pixels.shares(among)
        sample = Sample(own_image, shares, light_of_view[drawn.views], part.pixels.cells)
        return cls(part, starts, image[chosen], light_of_view, drawn, among, sample, settings, rng)

    @property
    def shown(self) -> ShownRadiance | None:
        """Radiance of the vertices, where photos of one light for all views show it."""
        return None if self.light_of_view.any() else self.part.shown

    def even_light(self) -> LightEstimate:
        """Build uniform light: beside the interreflection that photos show, else without any."""
        count, vertices = int(self.light_of_view.max(initial=0)) + 1, len(self.part.vertices.normals)
        light = np.ones((count, len(self.part.pixels.directions), 3))
        if self.shown is None:
            return LightEstimate(light, np.zeros((count, vertices, 3), np.float32))
        beside = LightEstimate(light, self.shown.interreflection(self.part.proxy)[None])
        return self._scaled(beside, self.settings.initial_brightest)

    def _scaled(self, now: LightEstimate, brightest: float) -> LightEstimate:
        """Scale one light beside its interreflection, by the reflectance of the brightest material."""
        where = self.part, self.starts, self.light_of_view
        direct = product(self.part.to_vertices, now.direct(*where))
        indirect = product(self.part.to_vertices, now.interreflected(*where))
        so_bright = (self._seen / brightest - indirect) / np.maximum(direct, NO_LIGHT)
        scale = brightest_albedo(so_bright, direct, self.settings.search.brightest_quantile)
        return replace(now, radiance=scale * now.radiance)

    def pairs(self, now: LightEstimate | None, scale: float) -> Pairs:
        """Pair pixels by their albedo under a light, weighted by reliability.

        None: paired by the image itself, and weighted as under uniform light.
        """
        image, light = self.sample.image, now or self.even_light()
        shading = light.shading(self.part, self.starts, self.light_of_view)[self.among]
        pairs = self.drawn.pairs(image / np.maximum(shading, NO_LIGHT) if now else image, self.rng)
        return weighted_by_reliability(image, shading, pairs, scale, self.settings.pairs)

    def bounce(self, now: LightEstimate) -> np.ndarray:
        """Compute the shading of the paired pixels by interreflection, (n, 3)."""
        out = np.zeros((len(self.among), 3))
        for own, bounce in enumerate(now.bounced):
            rows = self.sample.light_of == own
            out[rows] = product(self.part.pixels.blend[self.among[rows]], bounce)
        return out

    def loss(self, pairs: Pairs, scale: float) -> PairLoss:
        """Build the loss of pairs of the sample, to compare several lights by."""
        return PairLoss(self.sample.image, pairs, scale, self.settings.pairs)

    def objective(self, now: LightEstimate) -> PairObjective:
        """Build the objective at the finest scale, with the interreflection of the current light."""
        bounce, finest = self.bounce(now), self.settings.finest_scale
        pairs = self.pairs(now, finest)
        return PairObjective(self.sample, bounce, pairs, finest, self.settings)

    def light(self, step: Callable[[], None], near: LightEstimate | None = None) -> LightEstimate:
        """Estimate the light; arguments as of `estimate_light`."""
        how, now = self.settings.search, near
        for scale in how.scales if near is None else how.scales[-how.refined_scales :]:
            before, pairs = now or self.even_light(), self.pairs(now, scale)
            bounce = self.bounce(before)
            light = light_from_pairs(self.sample, bounce, pairs, scale, before.radiance, self.settings)
            now = self.settled(light, before)
            step()
        return now or self.even_light()

    def settled(self, light: np.ndarray, before: LightEstimate) -> LightEstimate:
        """Scale a light, (G, M, 3), by the reflectance `brightest`, and add its interreflection.

        `brightest` of None keeps the scale: of a light that is known, or found beside radiance that photos
        show, in the unit of the images. Without that radiance, albedo and interreflection are computed
        alternately, starting from those before. Without bounces the scale is arbitrary and is kept.
        """
        now, asked = LightEstimate(light, before.bounced), self.settings.brightest
        if self.shown is not None:
            now = self._scaled(now, asked) if asked else now
            proxy, vertices = self.part.proxy, self.part.vertices
            bounced = self.shown.interreflection_under(proxy, vertices, now.radiance[0], now.bounced[0])
            return replace(now, bounced=bounced[None])
        if not self.settings.bounces:
            return now
        scene, where = self.part, (self.part, self.starts, self.light_of_view)
        of_pixels = now.direct(*where)  # the rounds change interreflection; of direct light, only its scale
        of_vertices = np.stack([scene.vertices.shading(one) for one in light])
        scale, nearest = np.float32(1), scene.nearest_shown
        for _ in range(self.settings.search.bounce_rounds):
            shading = scale * of_pixels + now.interreflected(*where)
            albedo, weight = vertex_albedo(scene, self._seen, shading)
            factor = self._albedo_scale(albedo, weight)
            absolute, scale = np.clip(albedo / factor, 0, WHITEST)[nearest], np.float32(scale * factor)
            bounces = bounced_at_vertices(
                scene, scale * of_vertices, absolute, weight[nearest], self.settings.bounces
            )
            now = LightEstimate(scale * light, bounces)
        return now

    def brightest(self, now: LightEstimate) -> float:
        """Compute the reflectance of the brightest material under a light in the unit of the images."""
        shading = now.shading(self.part, self.starts, self.light_of_view)
        seen = vertex_albedo(self.part, self._seen, shading)
        return min(brightest_albedo(*seen, self.settings.search.brightest_quantile), WHITEST)

    @cached_property
    def _seen(self) -> np.ndarray:
        """Sum the image around every vertex, weighted by its blend, (P, 3)."""
        return product(self.part.to_vertices, self.image)

    def _albedo_scale(self, albedo: np.ndarray, light: np.ndarray) -> float:
        """Compute the factor by which the vertices' albedo, weighted by light, (P, 3) each, is too bright."""
        asked = self.settings.brightest
        if asked is None:
            return 1.0
        return brightest_albedo(albedo, light, self.settings.search.brightest_quantile) / asked


def estimate_light(
    scene: LitScene,
    views: StackedViews,
    image: np.ndarray,
    trusted: np.ndarray,
    light_of_view: np.ndarray,
    settings: LightSearchSettings,
    step: Callable[[], None] = lambda: None,
    near: LightEstimate | None = None,
) -> LightEstimate:
    """Estimate the light from pairs of pixels of equal albedo.

    Parameters
    ----------
    scene : LitScene
    views : StackedViews
        Their basis is not used.
    image : ndarray, shape (N, 3), float32
        Scaled; gains of the views divided out.
    trusted : ndarray, shape (N,), bool
        Pixels that are used.
    light_of_view : ndarray, shape (n,), int64
        Index, of G, of the light of every view: 0 everywhere for one light.
    settings : LightSearchSettings
    step : callable
        Called after every scale.
    near : LightEstimate or None
        Initial light not far from the solution; only the finest scales are then run.

    Notes
    -----
    The search starts from uniform light, or from `near`. At every scale, pairs are drawn by the current
    albedo; the light is optimised; then albedo and interreflection are recomputed under it, with the albedo's
    scale set by `brightest`. The cost does not grow with the number of pixels beyond `bounce_pixels`.
    """
    return Search.of(scene, views, image, trusted, light_of_view, settings).light(step, near)


def disagreements(
    scenes: Sequence[LitScene],
    lights: Sequence[LightEstimate],
    views: StackedViews,
    image: np.ndarray,
    trusted: np.ndarray,
    light_of_view: np.ndarray,
    settings: LightSearchSettings,
) -> list[float]:
    """Compute the loss of pairs under each of several lights, 0 to 1; see `estimate_light`.

    Notes
    -----
    All lights are compared on the same pairs, drawn by the albedo under each light. Where albedo varies in
    colour, most of the loss is due to albedo, and varies more between draws than between lights.
    """
    rng, how = np.random.default_rng(settings.search.seed), settings.pairs
    drawn = PixelSample.of(views, scenes[0].places, np.flatnonzero(trusted), settings.samples, rng, how)
    own, starts = image[drawn.pixels], np.searchsorted(drawn.pixels, views.starts)
    shadings = [
        light.shading(scene.at(drawn.pixels), starts, light_of_view)
        for scene, light in zip(scenes, lights, strict=True)
    ]
    draws = [drawn.pairs(own / np.maximum(shading, NO_LIGHT), rng) for shading in shadings]
    scale = settings.finest_scale
    losses = [PairLoss(own, pairs, scale, how) for pairs in draws]
    return [float(np.mean([loss.mean(shading) for loss in losses])) for shading in shadings]
