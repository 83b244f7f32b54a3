"""Clusters of pixels of about equal albedo, from a preliminary shading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.cluster.vq import kmeans, vq

from stages.photometry.specular.settings import ClusterSettings
from stages.photometry.stack import StackedViews


@dataclass(frozen=True, eq=False)
class ChromaticityClusters:
    """Clusters of albedo.

    Attributes
    ----------
    palette : ndarray, shape (k, 3)
        Their centres.
    typical : float
        Median brightness of the albedo.
    how : ClusterSettings
    """

    palette: np.ndarray
    typical: float
    how: ClusterSettings

    @classmethod
    def of(
        cls,
        views: StackedViews,
        image: np.ndarray,
        shading: np.ndarray,
        trusted: np.ndarray,
        how: ClusterSettings,
    ) -> tuple[ChromaticityClusters, np.ndarray]:
        """Find clusters, and the cluster of every pixel, (N,), int32, below `ClusterSettings.count`.

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
        typical = float(np.median(albedo[trusted].mean(axis=1)))
        seen = np.flatnonzero(trusted)
        seeds = _colours(albedo[seen[:: max(1, len(seen) // how.samples)]], typical, how)
        palette, _ = kmeans(seeds, min(how.count, len(seeds)), iter=how.runs, rng=0)
        found = cls(palette, typical, how)
        return found, found._assigned(views, albedo)

    def assigned(
        self, views: StackedViews, image: np.ndarray, shading: np.ndarray, trusted: np.ndarray
    ) -> np.ndarray:
        """Assign pixels of further views to the clusters, (N,), int32; arguments as of `of`."""
        albedo = _albedo_over_views(views, image, shading, trusted, self.how.min_shading)
        return self._assigned(views, albedo)

    def _assigned(self, views: StackedViews, albedo: np.ndarray) -> np.ndarray:
        """Find the nearest centre, view by view: colours take much memory."""
        parts = [
            vq(_colours(albedo[views.view(k)], self.typical, self.how), self.palette)[0].astype(np.int32)
            for k in range(views.view_count)
            if views.starts[k] < views.starts[k + 1]
        ]
        return np.concatenate(parts) if parts else np.zeros(0, np.int32)


def _albedo_over_views(
    views: StackedViews, image: np.ndarray, shading: np.ndarray, trusted: np.ndarray, min_shading: float
) -> np.ndarray:
    """Divide image by shading, both summed over a pixel and its correspondences, (N, 3)."""
    own = np.concatenate([np.maximum(image, 0), shading], axis=1)
    own *= trusted[:, None]
    together = own.copy()
    for (i, j), block in views.correspondences.items():
        together[views.view(i)] += block @ own[views.view(j)]
        together[views.view(j)] += block.T @ own[views.view(i)]
    return together[:, :3] / np.maximum(together[:, 3:], min_shading)


def _colours(albedo: np.ndarray, typical: float, how: ClusterSettings) -> np.ndarray:
    floor = how.log_floor * max(typical, 1e-6)
    red, green, blue = np.log(albedo.astype(np.float64) + floor).T
    return np.stack([how.brightness_weight * (red + green + blue) / 3, red - green, blue - green], axis=1)
