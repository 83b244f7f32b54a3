"""Paints: which pixels have about the same albedo, as far as it is known before it is sought."""

from __future__ import annotations

import numpy as np
from scipy.cluster.vq import kmeans, vq

from stages.photometry.stack import StackedViews

PALETTE = 10  # paints at most; more would part one where light is a little wrong
BRIGHTNESS = 0.2  # of a step of colour: how much one of brightness counts, which light may feign
FLOOR = 0.04  # of the typical brightness, under the logarithms
DARK = 0.01  # of the scaled shading: a quotient by less says nothing
SEEDS = 20_000  # pixels that the palette is made from, or up to twice as many
DRAWS = 5  # of the palette; the best one counts


def chromaticity_clusters(
    views: StackedViews, image: np.ndarray, shading: np.ndarray, trusted: np.ndarray
) -> np.ndarray:
    """Number the paint of every pixel, (N,), int32, below `PALETTE`.

    Parameters
    ----------
    views : StackedViews
    image, shading : ndarray, shape (N, 3)
    trusted : ndarray, shape (N,), bool
        At least one; others have the paint of what they are linked to, or any.

    Notes
    -----
    k-means of ``(b/5, log R/G, log B/G)``, b the mean logarithm, of what a pixel and all that it is linked to
    make of the albedo together, so that a highlight in one view is no paint of its own.
    """
    albedo = _albedo_seen_together(views, image, shading, trusted)
    colours = _colours(albedo, float(np.median(albedo[trusted].mean(axis=1))))
    seeds = colours[trusted]
    seeds = seeds[:: max(1, len(seeds) // SEEDS)]
    palette, _ = kmeans(seeds, min(PALETTE, len(seeds)), iter=DRAWS, rng=0)
    return vq(colours, palette)[0].astype(np.int32)


def _albedo_seen_together(
    views: StackedViews, image: np.ndarray, shading: np.ndarray, trusted: np.ndarray
) -> np.ndarray:
    """All light that a pixel and its like in other views send, by all that they are lit by, (N, 3)."""
    own = np.concatenate([np.maximum(image, 0), shading], axis=1) * trusted[:, None]
    together = own.copy()
    for (i, j), block in views.links.items():
        together[views.view(i)] += block @ own[views.view(j)]
        together[views.view(j)] += block.T @ own[views.view(i)]
    return together[:, :3] / np.maximum(together[:, 3:], DARK)


def _colours(albedo: np.ndarray, typical: float) -> np.ndarray:
    floor = FLOOR * max(typical, 1e-6)
    red, green, blue = np.log(albedo.astype(np.float64) + floor).T
    return np.stack([BRIGHTNESS * (red + green + blue) / 3, red - green, blue - green], axis=1)
