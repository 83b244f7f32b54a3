"""Clusters of views that have much surface in common, none with more pixels than asked."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp


def clusters_of(links: sp.csr_array, pixels: np.ndarray, most_pixels: float) -> list[np.ndarray]:
    """Divide views into clusters, by recursive spectral bisection.

    Parameters
    ----------
    links : csr_array, shape (n, n)
        Number of correspondences between two views; symmetric.
    pixels : ndarray, shape (n,)
        Masked pixels of every view.
    most_pixels : float
        Of a cluster; a view with more is a cluster of its own.

    Returns
    -------
    list of ndarray of int
        Views of each cluster, ascending; every view is in one.

    Notes
    -----
    A set with too many pixels is divided in two with about equally many, in the order of the Fiedler vector
    of its normalised Laplacian (Shi and Malik 2000), so that few correspondences are cut.
    """
    return [np.sort(one) for one in _divided(links, pixels, np.arange(len(pixels)), most_pixels)]


def _divided(
    links: sp.csr_array, pixels: np.ndarray, views: np.ndarray, most_pixels: float
) -> list[np.ndarray]:
    if len(views) < 2 or pixels[views].sum() <= most_pixels:
        return [views]
    ordered = views[np.argsort(_fiedler_vector(links[views][:, views]), kind="stable")]
    before = np.cumsum(pixels[ordered]) - pixels[ordered] / 2
    first = int(np.clip(np.searchsorted(before, pixels[ordered].sum() / 2), 1, len(views) - 1))
    return [
        part
        for half in (ordered[:first], ordered[first:])
        for part in _divided(links, pixels, half, most_pixels)
    ]


def _fiedler_vector(links: sp.csr_array) -> np.ndarray:
    """Compute the second eigenvector of ``D^-½ (D − W) D^-½``, times ``D^-½``; (n,)."""
    weight = links.toarray().astype(np.float64)
    weight += 1e-6 * max(weight.max(initial=0.0), 1.0)  # parts without common surface come out apart
    scale = 1 / np.sqrt(weight.sum(axis=1))
    laplacian = np.eye(len(weight)) - scale[:, None] * weight * scale
    vector = np.linalg.eigh(laplacian)[1][:, 1] * scale
    return vector * np.sign(vector[np.argmax(np.abs(vector))])  # eigenvectors have no sign of their own
