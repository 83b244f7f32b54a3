"""`mode: transfer`: the light from all around and from surface to surface, by pairs of like paint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from stages.photometry.alike_pairs import Drawn
from stages.photometry.light_from_pairs import PairWeights, Sample, disagreement, light_from_pairs
from stages.photometry.pixel_transfer import MOST
from stages.photometry.sky import SkyTransport, Sphere, offsets_in
from stages.photometry.stack import StackedViews
from stages.photometry.transfer import Occlusion, bounced

BRIGHT_QUANTILE = 0.98  # of the vertices' albedo, weighted by their light: the brightest material
LOOKED_AT = 300_000  # pixels that tell the albedo of the vertices while light is sought
SETTLES = 3  # rounds in which bounces and albedo find together under one light
NO_LIGHT = 1e-6  # of the scaled image's unit: surface with less says nothing about its albedo


@dataclass(frozen=True)
class SkySettings:
    """How the light is looked for.

    Attributes
    ----------
    bounces : int
        How often light is passed on between surfaces.
    samples : int
        Pixels that it is found from; as many again per light beyond the first, divided by four.
    scales : tuple of float
        See `light_from_pairs`: coarse first, as bounces find their place, and so that a sun's shadow, e times
        darker and more, is not at once taken for other paint; then finer.
    brightest : float
        What the brightest material reflects.
    weights : PairWeights
    seed : int
        Of the sample.
    """

    bounces: int
    samples: int = 20_000
    scales: tuple[float, ...] = (2.4, 1.2, 0.6, 0.4, 0.4)
    brightest: float = 0.9
    weights: PairWeights = PairWeights()
    seed: int = 0


@dataclass(frozen=True, eq=False)
class SkyScene:
    """What there is to see.

    Attributes
    ----------
    pixels : SkyTransport
        N, of all views.
    vertices : SkyTransport
        P, that bounces go between.
    seen : Occlusion
        What vertices see instead of the sky.
    """

    pixels: SkyTransport
    vertices: SkyTransport
    seen: Occlusion

    @classmethod
    def of(
        cls,
        normals: np.ndarray,
        blend: sp.csr_array,
        vertices: np.ndarray,
        vertex_normals: np.ndarray,
        seen: Occlusion,
        visible: np.ndarray,
        directions: int,
        sphere: Sphere | None,
    ) -> SkyScene:
        """Of pixels with normals (N, 3) that blend vertices (P, 3) with theirs; see `SkyTransport`."""
        own = sp.csr_array(sp.eye_array(len(vertices), dtype=np.float32, format="csr"))
        of_vertices = offsets_in(sphere, vertices)
        return cls(
            pixels=SkyTransport.of(normals, blend @ of_vertices, blend, visible, directions),
            vertices=SkyTransport.of(vertex_normals, of_vertices, own, visible, directions),
            seen=seen,
        )

    def at(self, pixels: np.ndarray) -> SkyScene:
        """The same with some of the pixels only."""
        return replace(self, pixels=self.pixels.at(pixels))


@dataclass(frozen=True, eq=False)
class FoundLight:
    """A light, and what it makes of the vertices.

    Attributes
    ----------
    radiance : ndarray, shape (G, M, 3)
        From every direction, at least 0.
    bounced : ndarray, shape (G, P, 3)
        Shading of the vertices by what comes from other surface.
    """

    radiance: np.ndarray
    bounced: np.ndarray

    def shading(self, scene: SkyScene, starts: np.ndarray, light_of_view: np.ndarray) -> np.ndarray:
        """Of a scene's pixels, view after view from ``starts``, (N, 3), float32; bounces included."""
        out = np.empty((int(starts[-1]), 3), np.float32)
        for view, own in enumerate(light_of_view):
            rows = slice(int(starts[view]), int(starts[view + 1]))
            out[rows] = scene.pixels.shading(self.radiance[own], rows)
            out[rows] += scene.pixels.blend[rows] @ self.bounced[own]
        return out


def sky_light(
    scene: SkyScene,
    views: StackedViews,
    image: np.ndarray,
    trusted: np.ndarray,
    light_of_view: np.ndarray,
    settings: SkySettings,
    step: Callable[[], None] = lambda: None,
) -> FoundLight:
    """Find the light.

    Parameters
    ----------
    scene : SkyScene
    views : StackedViews
        Their basis is not looked at.
    image : ndarray, shape (N, 3), float32
        Scaled; gains of the views divided out.
    trusted : ndarray, shape (N,), bool
        Pixels that are looked at.
    light_of_view : ndarray, shape (n,), int64
        Which of the G lights every view stands in: 0 everywhere for one light.
    settings : SkySettings
    step : callable
        Called after every scale.

    Notes
    -----
    Starting from even light, at every scale: pairs are drawn by what the albedo seems to be; the light
    descends; then albedo and bounces settle under it, the albedo's scale being set by `brightest`. The cost
    does not grow with the number of pixels beyond `LOOKED_AT`.
    """
    rng, count = np.random.default_rng(settings.seed), int(light_of_view.max(initial=0)) + 1
    looked = np.flatnonzero(trusted)
    looked = np.sort(rng.choice(looked, min(LOOKED_AT, looked.size), replace=False))
    part, starts, seen = scene.at(looked), np.searchsorted(looked, views.starts), image[looked]
    drawn = Drawn.of(views, looked, settings.samples * (3 + count) // 4, rng)
    among = np.searchsorted(looked, drawn.pixels)
    own_image = image[drawn.pixels].astype(np.float64)
    sample = Sample(own_image, part.pixels.shares(among), light_of_view[drawn.views])
    light = np.ones((count, len(scene.pixels.directions), 3))
    now = FoundLight(light, np.zeros((count, len(scene.vertices.normals), 3), np.float32))
    bounce, guess = np.zeros((len(among), 3)), sample.image
    for scale in settings.scales:
        pairs = drawn.pairs(guess, rng)
        light = light_from_pairs(sample, bounce, pairs, scale, now.radiance, settings.weights)
        now = FoundLight(light, now.bounced)
        for _ in range(SETTLES if settings.bounces else 0):
            now = _settled(part, starts, seen, light_of_view, now, settings)
        shading = now.shading(part, starts, light_of_view)[among]
        guess = sample.image / np.maximum(shading, NO_LIGHT)
        bounce = np.zeros((len(among), 3))
        for own in range(count):
            rows = sample.light_of == own
            bounce[rows] = part.pixels.blend[among[rows]] @ now.bounced[own]
        step()
    return now


def disagreements(
    scenes: Sequence[SkyScene],
    lights: Sequence[FoundLight],
    views: StackedViews,
    image: np.ndarray,
    trusted: np.ndarray,
    light_of_view: np.ndarray,
    settings: SkySettings,
) -> list[float]:
    """What pairs of like paint disagree by under each of several lights, 0 to 1; arguments as of `sky_light`.

    Notes
    -----
    The same pairs for all, drawn by what each light makes of the albedo: where paint is of many colours most
    of the loss is paint's, and differs by more from draw to draw than from light to light.
    """
    rng = np.random.default_rng(settings.seed)
    drawn = Drawn.of(views, np.flatnonzero(trusted), settings.samples, rng)
    seen, starts = image[drawn.pixels], np.searchsorted(drawn.pixels, views.starts)
    shadings = [
        light.shading(scene.at(drawn.pixels), starts, light_of_view)
        for scene, light in zip(scenes, lights, strict=True)
    ]
    draws = [drawn.pairs(seen / np.maximum(shading, NO_LIGHT), rng) for shading in shadings]
    scale, noise = settings.scales[-1], settings.weights.noise
    return [
        float(np.mean([disagreement(seen, shading, pairs, scale, noise) for pairs in draws]))
        for shading in shadings
    ]


def _settled(
    scene: SkyScene,
    starts: np.ndarray,
    image: np.ndarray,
    light_of_view: np.ndarray,
    now: FoundLight,
    settings: SkySettings,
) -> FoundLight:
    """The light at the scale that `brightest` asks for, and the bounces that the albedo under it sends on."""
    albedo, known = vertex_albedo(scene, image, now.shading(scene, starts, light_of_view))
    factor = _brightest(albedo, known) / settings.brightest
    absolute, radiance = np.clip(albedo / factor, 0, MOST), now.radiance * factor
    direct = np.stack([scene.vertices.shading(one) for one in radiance])
    at_vertices = _bounced(scene, direct, absolute, known, settings.bounces)
    return FoundLight(radiance, at_vertices)


def vertex_albedo(scene: SkyScene, image: np.ndarray, shading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Albedo of the vertices, and the light that it is known by, (P, 3) each.

    The photos' light over the shading's, all pixels around a vertex together: what is dark says little.
    """
    to_vertices = scene.pixels.blend.T.tocsr()
    seen, light = to_vertices @ image, to_vertices @ shading
    return np.where(light > NO_LIGHT, seen / np.maximum(light, NO_LIGHT), 0), light


def _brightest(albedo: np.ndarray, known: np.ndarray) -> float:
    """A high quantile of all channels, weighted by the light that they are known by."""
    order = np.argsort(albedo, axis=None)
    upto = np.cumsum(known.ravel()[order], dtype=np.float64)
    if upto.size == 0 or upto[-1] <= 0:
        return 1.0
    bright = float(albedo.ravel()[order][np.searchsorted(upto, BRIGHT_QUANTILE * upto[-1])])
    return bright if bright > 0 else 1.0


def _bounced(
    scene: SkyScene, direct: np.ndarray, absolute: np.ndarray, known: np.ndarray, bounces: int
) -> np.ndarray:
    """Shading of the vertices by what other surface sends on, under each light: (G, P, 3), float32."""
    at_vertices = np.empty_like(direct)
    for c in range(3):
        lit = known[:, c] > NO_LIGHT
        typical = float(np.median(absolute[lit, c])) if lit.any() else 0.0
        albedo = np.where(lit, absolute[:, c], typical).astype(np.float32)
        from_sky = np.ascontiguousarray(direct[:, :, c].T)  # all lights at once
        total = bounced(from_sky, scene.seen, albedo, typical, bounces)
        at_vertices[:, :, c] = (total - from_sky).T
    return at_vertices
