"""`mode: transfer`: first the light, by what it makes of like paint; then the albedo under it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stages.photometry.albedo_under_light import albedo_under_light
from stages.photometry.appearance import appearance_of
from stages.photometry.fast_alternation import FastDescent, FastSettings
from stages.photometry.highlights import Linked, brightening, without_highlights
from stages.photometry.paint_detail import with_detail
from stages.photometry.paint_edges import (
    PaintEdges,
    agreement_of_links,
    in_white_light,
    smoothness_of_edges,
)
from stages.photometry.saddle import ALIKE, EdgeWeights
from stages.photometry.sky_light import FoundLight, SkyScene, SkySettings, disagreements, sky_light
from stages.photometry.stack import StackedViews
from stages.photometry.view_gains import ViewGains, view_gains
from stages.solvers.threading_layer import use_threads

NEARER = 0.01  # by how much less disagreement light from nearby must leave to be believed in
GLOSSY = 1.05  # `brightening` above which it is gloss that makes views differ
UNLIT = 0.02  # of the median shading: a quotient by less says nothing


@dataclass(frozen=True)
class SkyDecomposition:
    """What is asked for.

    Attributes
    ----------
    light : SkySettings
    lighting : str
        One light for all views, or one for each; auto: by `moving` and `GLOSSY`.
    moving : float
        Spread of the views (see `ViewGains`) above which the light is taken to differ between them, unless
        they differ as gloss makes them (see `brightening`).
    edges : PaintEdges
        Of `albedo`.
    descent : FastSettings
        Of the albedo; λ and μ are those of `albedo_tv`, μ is the least that links have in `albedo`.
    """

    light: SkySettings
    lighting: Literal["auto", "shared", "per-view"]
    moving: float
    edges: PaintEdges
    descent: FastSettings


@dataclass(frozen=True, eq=False)
class SkyLight:
    """The light, (G, M, 3), at least 0, and the shading of all pixels by it, (N, 3), float32."""

    radiance: np.ndarray
    shading: np.ndarray


@dataclass(frozen=True, eq=False)
class SkySolution:
    """What is found; pixels as in the stack, images scaled.

    Attributes
    ----------
    light : SkyLight
        Its shading with the gains of the views.
    scene : int
        Which of the scenes explains the photos best.
    disagreements : list of float
        Of all scenes.
    gains : ViewGains
    brightening : float
        Of the views, after these.
    light_of_view : ndarray, shape (n,), int64
    trusted : ndarray, shape (N,), bool
        Pixels whose data counted.
    smooth : FastDescent
        Eq. 2's ρ under that light, for `albedo_tv`.
    detailed : FastDescent
        Before the detail came back that the photos have.
    albedo : ndarray, shape (N, 3), float32
        With it.
    directions : ndarray, shape (M, 3)
        Of the light.
    """

    light: SkyLight
    scene: int
    disagreements: list[float]
    gains: ViewGains
    brightening: float
    light_of_view: np.ndarray
    trusted: np.ndarray
    smooth: FastDescent
    detailed: FastDescent
    albedo: np.ndarray
    directions: np.ndarray


def decompose_by_sky(
    views: StackedViews,
    images: list[np.ndarray],
    scenes: Sequence[SkyScene],
    trusted: np.ndarray,
    settings: SkyDecomposition,
    threads: int,
    step: Callable[[], None],
) -> SkySolution:
    """Find the light, then the albedo.

    Parameters
    ----------
    views : StackedViews
    images : list of 3 ndarray, shape (N,)
        Scaled.
    scenes : sequence of SkyScene
        The same under light from other distances: that whose light leaves the least disagreement is taken.
    trusted : ndarray, shape (N,), bool
        Pixels whose data count, for the light as well, as far as one knows without it. If there are none,
        all do.
    settings : SkyDecomposition
    threads : int
        Never changes the result.
    step : callable
        Called after every step of the light and every round of the albedo.
    """
    image = np.stack(images, axis=1)
    use_threads(threads)
    if not trusted.any():
        trusted = np.ones_like(trusted)
    gains = view_gains(views, image, trusted)
    of_pixel = np.repeat(gains.gains, np.diff(views.starts), axis=0).astype(np.float32)
    light_of_view, rise, matt = _lights_and_gloss(settings, views, image / of_pixel, trusted, gains.spread)
    lights = [sky_light(scene, views, matt, trusted, light_of_view, settings.light, step) for scene in scenes]
    left = disagreements(scenes, lights, views, matt, trusted, light_of_view, settings.light)
    best = explained_best(left)
    light = _shaded(scenes[best], views, lights[best], light_of_view, of_pixel)
    lit = trusted & (light.shading.mean(axis=1) > UNLIT * np.median(light.shading))
    trusted = lit if lit.any() else trusted
    matt *= of_pixel
    shown, white = (in_white_light(one, light.shading) for one in (image, matt))
    look = appearance_of(views, shown, light.shading, trusted, settings.edges)
    by_edge = EdgeWeights(
        smoothness_of_edges(views, white, light.shading, look.textured, settings.edges),
        agreement_of_links(views, settings.descent.weights.consistency, look.disputed),
    )
    channels = list(np.ascontiguousarray(matt.T))
    smooth, detailed = (
        albedo_under_light(views, channels, light.shading, trusted, each, settings.descent, threads, step)
        for each in (ALIKE, by_edge)
    )
    albedo = with_detail(detailed.albedo, matt, light.shading, trusted, look.textured)
    towards = scenes[best].pixels.directions
    light_found = (light, best, left, gains, rise, light_of_view)
    return SkySolution(*light_found, trusted, smooth, detailed, albedo, towards)


def explained_best(left: Sequence[float]) -> int:
    """Index of the least; the first, light from far away, unless another is clearly better."""
    best = int(np.argmin(left))
    return best if left[best] < (1 - NEARER) * left[0] else 0


def _lights_and_gloss(
    settings: SkyDecomposition, views: StackedViews, image: np.ndarray, trusted: np.ndarray, spread: float
) -> tuple[np.ndarray, float, np.ndarray]:
    """Which light every view stands in, (n,), the views' brightening, the image without its gloss."""
    linked = Linked.of(views, trusted)
    rise = brightening(linked, image)
    light_of_view = _lights(settings, spread, rise, views.view_count)
    one_light = not light_of_view.any()  # matt surface then looks the same in all views
    return light_of_view, rise, without_highlights(linked, image) if one_light else image


def _lights(settings: SkyDecomposition, spread: float, rise: float, count: int) -> np.ndarray:
    apart = settings.lighting == "per-view"
    if settings.lighting == "auto":
        apart = spread > settings.moving and rise < GLOSSY
    return np.arange(count) if apart else np.zeros(count, np.int64)


def _shaded(
    scene: SkyScene,
    views: StackedViews,
    found: FoundLight,
    light_of_view: np.ndarray,
    of_pixel: np.ndarray,
) -> SkyLight:
    """Give the views their gains back, and scale the light so that the mean shading is 1 in each channel."""
    shading = found.shading(scene, views.starts, light_of_view) * of_pixel
    mean = shading.mean(axis=0, dtype=np.float64).astype(np.float32)
    mean = np.where(mean > 0, mean, np.float32(1))
    return SkyLight(found.radiance / mean, shading / mean)
