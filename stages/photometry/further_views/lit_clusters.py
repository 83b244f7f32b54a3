"""Shading and observations of further views, under an illumination that was estimated from some."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from stages.photometry.albedo_data import AlbedoData
from stages.photometry.clusters.parts import Parts
from stages.photometry.clusters.surface_clusters import Cluster
from stages.photometry.further_views.seen_vertices import SurfaceViews
from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.lighting.illumination import Explanation, Illumination
from stages.photometry.lighting.observations import Observations
from stages.photometry.lighting.trusted_pixels import Viewing, unlit
from stages.photometry.specular.highlights import LinkedPatches
from stages.photometry.specular.specular_reflection import SpecularReflection
from stages.photometry.stack import StackedViews
from stages.photometry.sun.cast_shadows import cast_shadows
from stages.photometry.sun.pixel_rays import PixelRays
from stages.photometry.transport.lit_scenes import LitScene
from stages.photometry.transport.pixel_transfer import without_opposed
from stages.scene.cameras import Camera
from stages.solvers.kernels.pixelwise import on_threads
from stages.solvers.kernels.threading_layer import use_threads


@dataclass(frozen=True, eq=False)
class LightTask:
    """All that the pixels of clusters are lit from. Picklable.

    Attributes
    ----------
    views : SurfaceViews
    rays : callable
        Makes their rays, of masked pixels of cameras and with a number of threads.
    parts : Parts
        Where shading and data of the pixels are kept, until they are put together view by view.
    found : Illumination
        Of some views, without their pixels.
    """

    views: SurfaceViews
    rays: Callable[[Sequence[Camera], Sequence[np.ndarray], int], PixelRays]
    parts: Parts
    found: Illumination


def light_cluster(cluster: Cluster, task: LightTask, threads: int) -> tuple[int, int, int, int]:
    """Light a cluster, and keep its pixels; count clipped, untrusted, usable, shadowed ones. Picklable."""
    use_threads(threads)
    every = task.views
    opened = every.files.open(cluster, every.scale, on_threads)
    blend = every.blend(opened.views.cameras, opened.views.masks, on_threads)
    blend, _ = without_opposed(opened.normals, blend, every.vertex_normals)
    image, scene = np.stack(opened.images, axis=1), task.found.explained.scene
    suns = scene.suns, scene.sphere
    traced = task.rays(opened.views.cameras, opened.views.masks, threads).see(*suns, opened.normals)
    shading, data, shadowed = further_pixels(
        task.found,
        opened.views.stack,
        image,
        opened.viewing,
        opened.normals,
        blend,
        traced,
        every.gains[opened.views.numbers],
    )
    task.parts.keep(cluster, opened.views, {"shading": shading, **data.by_pixel()})
    own, usable = opened.views.own, opened.viewing.trusted
    chosen = ~opened.unclipped & own, ~(usable & data.trusted) & own, usable & own, shadowed & own
    clipped, untrusted, used, dark = (int(np.count_nonzero(pixels)) for pixels in chosen)
    return clipped, untrusted, used, dark


def further_pixels(
    found: Illumination,
    views: StackedViews,
    image: np.ndarray,
    viewing: Viewing,
    normals: np.ndarray,
    blend: sp.csr_array,
    traced: np.ndarray,
    gains: np.ndarray,
) -> tuple[np.ndarray, AlbedoData, np.ndarray]:
    """Compute shading and data for the albedo, of pixels that the light was not estimated from.

    Parameters
    ----------
    found : Illumination
        One light for all views.
    views : StackedViews
    image : ndarray, shape (N, 3), float32
        In the unit of the images that the light was estimated from.
    viewing : Viewing
    normals : ndarray, shape (N, 3)
    blend : csr_array, shape (N, P)
        Of the proxy's vertices; empty where the back of the mesh is seen.
    traced : ndarray, shape (N, k), uint8
        Visibility of the suns.
    gains : ndarray, shape (n, 3)

    Returns
    -------
    tuple of ndarray, shape (N, 3), float32, AlbedoData, and ndarray, shape (N,), bool
        Shading and data, view gains included; pixels in the shadow of what the mesh does not have.

    Raises
    ------
    ValueError
        The views have lights of their own.
    """
    own, light = found.explained, found.explained.light
    if found.apart:
        raise ValueError("further views have the light of the others only if that is one for all")
    of_pixel = np.repeat(gains, np.diff(views.starts), axis=0).astype(np.float32)
    scene = own.scene.with_pixels(normals, blend, traced)
    shading = light.shading(scene, views.starts, np.zeros(views.view_count, np.int64))
    photos = _observed(own, views, (image / of_pixel).astype(np.float32), viewing)
    if viewing.trusted.any():
        photos = photos.in_one_light(LinkedPatches.of(views, viewing.trusted, photos.settings.highlights))
        if own.specular is not None and own.removed_under is not None:
            photos = _without_gloss(own.specular, own.removed_under, photos, normals, blend)
    how, hidden = photos.settings, np.zeros((len(image), 1), bool)
    if how.sun.shadows.find and traced.shape[1]:
        seen = photos.diffuse, photos.viewing.trusted, views.masks, views.side
        traced, hidden = cast_shadows(scene, light, shading, *seen, how.pairs, how.sun.shadows)
        scene = replace(scene, pixels=replace(scene.pixels, traced=traced))  # vertices keep their bounces
        shading = light.shading(scene, views.starts, np.zeros(views.view_count, np.int64))
    shading = (shading / found.light.unit).astype(np.float32)
    lit = photos.viewing.trusted & ~unlit(shading, found.typical_shading, photos.settings.trusted_pixels)
    shading *= of_pixel
    radiances = photos.observed * of_pixel, photos.diffuse * of_pixel
    data = AlbedoData(*radiances, lit, viewing.clipped, own.glossy)
    return shading, data, np.any(hidden, axis=1)


def _observed(own: Explanation, views: StackedViews, image: np.ndarray, viewing: Viewing) -> Observations:
    return replace(
        own.photos,
        views=views,
        viewing=viewing,
        observed=image,
        diffuse=image,
        light_of_view=np.zeros(views.view_count, np.int64),
    )


def _without_gloss(
    specular: SpecularReflection,
    removed_under: tuple[LitScene, LightEstimate],
    photos: Observations,
    normals: np.ndarray,
    blend: sp.csr_array,
) -> Observations:
    """Remove the reflection of the light that it was estimated with."""
    no_suns = np.zeros((len(normals), 0), np.uint8)  # it was estimated before these
    scene, light = removed_under[0].with_pixels(normals, blend, no_suns), removed_under[1]
    here = replace(specular, glossy=_glossy(specular, photos, scene))
    return photos.without_specular(here, photos.mirror(scene, light))


def _glossy(specular: SpecularReflection, photos: Observations, scene: LitScene) -> np.ndarray:
    """Select the pixels of glossy paints, (N,), bool."""
    if specular.paints is None:
        return np.ones(len(photos.observed), bool)
    paints = specular.paints
    shading = photos.shading(scene, paints.light)
    cluster = paints.clusters.assigned(photos.views, photos.diffuse, shading, photos.viewing.trusted)
    return np.isin(cluster, paints.numbers)
