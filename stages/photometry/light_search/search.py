"""The search for the light from all around and from surface to surface, by pairs of like paint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.light_from_pairs import (
    PairObjective,
    Sample,
    disagreement,
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


@dataclass(frozen=True, eq=False)
class Search:
    """Some pixels of a scene: those that the light is found from, and those that the bounces are found from.

    Attributes
    ----------
    part : LitScene
        With `bounce_pixels` at most.
    starts : ndarray, shape (n + 1,)
        Where every view begins among these.
    image : ndarray, shape (m, 3)
        What is seen of them.
    light_of_view : ndarray, shape (n,), int64
    drawn : PixelSample
        Those that are paired.
    among : ndarray
        Where these are in `part`.
    sample : Sample
        Of these.
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
        looked = np.flatnonzero(trusted)
        looked = np.sort(rng.choice(looked, min(how.bounce_pixels, looked.size), replace=False))
        part, starts = scene.at(looked), np.searchsorted(looked, views.starts)
        count = int(settings.samples * (1 + how.further_light_share * further))
        drawn = PixelSample.of(views, scene.places, looked, count, rng, settings.pairs)
        among = np.searchsorted(looked, drawn.pixels)
        own_image = image[drawn.pixels].astype(np.float64)
        shares = part.pixels.shares(among)
        sample = Sample(own_image, shares, light_of_view[drawn.views], part.pixels.cells)
        return cls(part, starts, image[looked], light_of_view, drawn, among, sample, settings, rng)

    def even_light(self) -> LightEstimate:
        """One from everywhere alike, that surface does not send on."""
        count, vertices = int(self.light_of_view.max(initial=0)) + 1, len(self.part.vertices.normals)
        light = np.ones((count, len(self.part.pixels.directions), 3))
        return LightEstimate(light, np.zeros((count, vertices, 3), np.float32))

    def pairs(self, now: LightEstimate | None, scale: float) -> Pairs:
        """Pairs by what the albedo seems to be under a light, as far as they are believed.

        None: by the image itself, and believed as under even light.
        """
        image, light = self.sample.image, now or self.even_light()
        shading = light.shading(self.part, self.starts, self.light_of_view)[self.among]
        pairs = self.drawn.pairs(image / np.maximum(shading, NO_LIGHT) if now else image, self.rng)
        return weighted_by_reliability(image, shading, pairs, scale, self.settings.pairs)

    def bounce(self, now: LightEstimate) -> np.ndarray:
        """Shading of the paired pixels by light from other surface, (n, 3)."""
        out = np.zeros((len(self.among), 3))
        for own, bounce in enumerate(now.bounced):
            rows = self.sample.light_of == own
            out[rows] = self.part.pixels.blend[self.among[rows]] @ bounce
        return out

    def objective(self, now: LightEstimate) -> PairObjective:
        """What pairs disagree by at the finest scale, and the priors; by the bounces of the light so far."""
        bounce, finest = self.bounce(now), self.settings.finest_scale
        pairs = self.pairs(now, finest)
        return PairObjective(self.sample, bounce, pairs, finest, self.settings, len(now.radiance))

    def light(self, step: Callable[[], None], near: LightEstimate | None = None) -> LightEstimate:
        """Find the light; arguments as of `estimate_light`."""
        how, now = self.settings.search, near
        for scale in how.scales if near is None else how.scales[-how.refined_scales :]:
            before, pairs = now or self.even_light(), self.pairs(now, scale)
            bounce = self.bounce(before)
            light = light_from_pairs(self.sample, bounce, pairs, scale, before.radiance, self.settings)
            now = self.settled(light, before)
            step()
        return now or self.even_light()

    def settled(self, light: np.ndarray, before: LightEstimate) -> LightEstimate:
        """A light, (G, M, 3), at the scale that `brightest` asks for, with the bounces that it then has.

        None: at its own scale, where light and images are in one unit.

        Albedo and bounces find together, from those before on. Without bounces its scale is as good as any.
        """
        now = LightEstimate(light, before.bounced)
        if not self.settings.bounces:
            return now
        scene, where = self.part, (self.part, self.starts, self.light_of_view)
        of_pixels = now.direct(*where)  # what is sent on changes in the rounds; of this, its scale alone
        of_vertices = np.stack([scene.vertices.shading(one) for one in light])
        scale, nearest = np.float32(1), scene.nearest_shown
        for _ in range(self.settings.search.bounce_rounds):
            shading = scale * of_pixels + now.sent_on(*where)
            albedo, known = vertex_albedo(scene, self.image, shading)
            factor = self._albedo_scale(albedo, known)
            absolute, scale = np.clip(albedo / factor, 0, WHITEST)[nearest], np.float32(scale * factor)
            sent_on = bounced_at_vertices(
                scene, scale * of_vertices, absolute, known[nearest], self.settings.bounces
            )
            now = LightEstimate(scale * light, sent_on)
        return now

    def _albedo_scale(self, albedo: np.ndarray, known: np.ndarray) -> float:
        """How many times too bright an albedo of the vertices is, known by so much light, (P, 3) each."""
        asked = self.settings.brightest
        if asked is None:
            return 1.0
        return brightest_albedo(albedo, known, self.settings.search.brightest_quantile) / asked


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
    """Find the light.

    Parameters
    ----------
    scene : LitScene
    views : StackedViews
        Their basis is not looked at.
    image : ndarray, shape (N, 3), float32
        Scaled; gains of the views divided out.
    trusted : ndarray, shape (N,), bool
        Pixels that are looked at.
    light_of_view : ndarray, shape (n,), int64
        Which of the G lights every view stands in: 0 everywhere for one light.
    settings : LightSearchSettings
    step : callable
        Called after every scale.
    near : LightEstimate or None
        One that is not far from it, to go on from at the finest scales.

    Notes
    -----
    Starting from even light, or from one that is near, at every scale: pairs are drawn by what the albedo
    seems to be; the light descends; then albedo and bounces settle under it, the albedo's scale being set by
    `brightest`. The cost does not grow with the number of pixels beyond `bounce_pixels`.
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
    """What pairs of like paint disagree by under each of several lights, 0 to 1; see `estimate_light`.

    Notes
    -----
    The same pairs for all, drawn by what each light makes of the albedo: where paint is of many colours most
    of the loss is paint's, and differs by more from draw to draw than from light to light.
    """
    rng, how = np.random.default_rng(settings.search.seed), settings.pairs
    drawn = PixelSample.of(views, scenes[0].places, np.flatnonzero(trusted), settings.samples, rng, how)
    seen, starts = image[drawn.pixels], np.searchsorted(drawn.pixels, views.starts)
    shadings = [
        light.shading(scene.at(drawn.pixels), starts, light_of_view)
        for scene, light in zip(scenes, lights, strict=True)
    ]
    draws = [drawn.pairs(seen / np.maximum(shading, NO_LIGHT), rng) for shading in shadings]
    scale = settings.finest_scale
    return [
        float(np.mean([disagreement(seen, shading, pairs, scale, how) for pairs in draws]))
        for shading in shadings
    ]
