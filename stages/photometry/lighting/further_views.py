"""Shading and observations of further views, under an illumination that was estimated from some."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stages.photometry.albedo_data import AlbedoData
from stages.photometry.lighting.illumination import Illumination
from stages.photometry.lighting.observations import Observations
from stages.photometry.lighting.trusted_pixels import Viewing, unlit
from stages.photometry.specular.highlights import LinkedPatches
from stages.photometry.specular.specular_reflection import SpecularReflection
from stages.photometry.stack import StackedViews
from stages.photometry.transport.lit_scenes import LitScene


def further_pixels(
    found: Illumination,
    typical_shading: float,
    views: StackedViews,
    image: np.ndarray,
    viewing: Viewing,
    scene: LitScene,
    gains: np.ndarray,
) -> tuple[np.ndarray, AlbedoData]:
    """Compute shading and data for the albedo, of pixels that the light was not estimated from.

    Parameters
    ----------
    found : Illumination
        One light for all views.
    typical_shading : float
        Median over the pixels that it was estimated from.
    views : StackedViews
    image : ndarray, shape (N, 3), float32
        In the unit of the images that the light was estimated from.
    viewing : Viewing
        If no pixel is trusted, all are.
    scene : LitScene
        That of the light, with these pixels.
    gains : ndarray, shape (n, 3)

    Returns
    -------
    tuple of ndarray, shape (N, 3), float32, and AlbedoData
        View gains included.

    Raises
    ------
    ValueError
        The views have lights of their own.
    """
    own, light = found.explained, found.explained.light
    if found.apart:
        raise ValueError("further views have the light of the others only if that is one for all")
    if not viewing.trusted.any():
        viewing = replace(viewing, trusted=np.ones_like(viewing.trusted))
    of_pixel = np.repeat(gains, np.diff(views.starts), axis=0).astype(np.float32)
    observed = (image / of_pixel).astype(np.float32)
    photos = replace(
        own.photos,
        views=views,
        viewing=viewing,
        observed=observed,
        diffuse=observed,
        light_of_view=np.zeros(views.view_count, np.int64),
    )
    photos = photos.in_one_light(LinkedPatches.of(views, viewing.trusted, photos.settings.highlights))
    shading = photos.shading(scene, light)
    if own.specular is not None:
        here = replace(own.specular, glossy=_glossy(own.specular, photos, shading))
        photos = photos.without_specular(here, photos.mirror(scene, light))
    shading = (shading * of_pixel / found.light.unit).astype(np.float32)
    lit = photos.viewing.without(unlit(shading, typical_shading, photos.settings.trusted_pixels))
    data = AlbedoData(photos.observed * of_pixel, photos.diffuse * of_pixel, lit.trusted, own.glossy)
    return shading, data


def _glossy(specular: SpecularReflection, photos: Observations, shading: np.ndarray) -> np.ndarray:
    """Select the pixels of glossy paints, (N,), bool."""
    if specular.paints is None:
        return np.ones(len(shading), bool)
    clusters, numbers = specular.paints.clusters, specular.paints.numbers
    cluster = clusters.assigned(photos.views, photos.diffuse, shading, photos.viewing.trusted)
    return np.isin(cluster, numbers)
