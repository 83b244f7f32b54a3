"""Clusters of pixels of about equal albedo, from a preliminary shading."""

from __future__ import annotations

import numpy as np
from scipy.cluster.vq import kmeans, vq

from stages.photometry.specular.settings import ClusterSettings
from stages.photometry.stack import StackedViews


def chromaticity_clusters(
    views: StackedViews, image: np.ndarray, shading: np.ndarray, trusted: np.ndarray, how: ClusterSettings
) -> np.ndarray:
    """Assign every pixel to a cluster of albedo, (N,), int32, below `ClusterSettings.count`.

    Parameters
    ----------
    views : StackedViews
    image, shading : ndarray, shape (N, 3)
    trusted : ndarray, shape (N,), bool
        At least one; others get the cluster of their correspondences, or an arbitrary one.
    how : ClusterSettings

    Notes
    -----
    k-means of ``(w b, log R/G, log B/G)``, b the mean logarithm, w `brightness_weight`, of the albedo
    averaged over a pixel and its correspondences, so that a highlight in one view forms no cluster of its
    own.
    """
    albedo = _albedo_over_views(views, image, shading, trusted, how.min_shading)
    colours = _colours(albedo, float(np.median(albedo[trusted].mean(axis=1))), how)
    seeds = colours[trusted]
    seeds = seeds[:: max(1, len(seeds) // how.samples)]
    palette, _ = kmeans(seeds, min(how.count, len(seeds)), iter=how.runs, rng=0)
    return vq(colours, palette)[0].astype(np.int32)


def _albedo_over_views(
    views: StackedViews, image: np.ndarray, shading: np.ndarray, trusted: np.ndarray, min_shading: float
) -> np.ndarray:
    """Divide image by shading, both summed over a pixel and its correspondences, (N, 3)."""
    own = np.concatenate([np.maximum(image, 0), shading], axis=1) * trusted[:, None]
    together = own.copy()
    for (i, j), block in views.correspondences.items():
        together[views.view(i)] += block @ own[views.view(j)]
        together[views.view(j)] += block.T @ own[views.view(i)]
    return together[:, :3] / np.maximum(together[:, 3:], min_shading)


def _colours(albedo: np.ndarray, typical: float, how: ClusterSettings) -> np.ndarray:
    floor = how.log_floor * max(typical, 1e-6)
    red, green, blue = np.log(albedo.astype(np.float64) + floor).T
    return np.stack([how.brightness_weight * (red + green + blue) / 3, red - green, blue - green], axis=1)
