"""Clusters of views that have much surface in common, none with more pixels than asked, and their halos."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

GOLDEN = (5**0.5 - 1) / 2
WORTHWHILE = 0.8
APART = 1e-6  # of the most links of a pair: joins views without common surface, so that parts come out apart


@dataclass(frozen=True, eq=False)
class ViewGraph:
    """Sizes of the views, and correspondences between them.

    Attributes
    ----------
    pixels : ndarray, shape (n,), int64
        Masked pixels of every view.
    links : csr_array, shape (n, n), int64
        Number of correspondences between two views; symmetric.
    side : float
        Mean side of the views, taken as squares, px.
    """

    pixels: np.ndarray
    links: sp.csr_array
    side: float

    @property
    def links_per_pixel(self) -> float:
        """Mean number of correspondences per pixel."""
        return float(self.links.sum()) / max(int(self.pixels.sum()), 1)


@dataclass(frozen=True)
class Cluster:
    """Views that are solved together, by number, ascending.

    Attributes
    ----------
    own : tuple of int
        Those whose solution is kept.
    halo : tuple of int
        Others that correspond to them: of these only the corresponding pixels take part.
    """

    own: tuple[int, ...]
    halo: tuple[int, ...]

    @classmethod
    def of(cls, own: np.ndarray, links: sp.csr_array) -> Cluster:
        """Find the halo of some views."""
        linked = np.unique(links[own].nonzero()[1])
        return cls(tuple(sorted(own.tolist())), tuple(np.setdiff1d(linked, own).tolist()))


def clusters_of(graph: ViewGraph, most_pixels: float) -> list[Cluster]:
    """Divide all views into clusters, by recursive spectral bisection.

    Parameters
    ----------
    graph : ViewGraph
    most_pixels : float
        That take part in a cluster, those of its halo included (`size_of`); a single view is not divided.

    Notes
    -----
    A set in which too many take part is divided into two with about equally many, in the order of the Fiedler
    vector of its normalised Laplacian (Shi and Malik 2000), so that few correspondences are cut. Where no
    division has room, and the least leaves a cluster of `WORTHWHILE` of the set, it stays whole: each view
    corresponds to most of the others.
    """
    parts, _ = _divided(graph, np.arange(len(graph.pixels)), most_pixels)
    return [Cluster.of(part, graph.links) for part in sorted(parts, key=min)]


def size_of(cluster: Cluster, graph: ViewGraph) -> tuple[float, float]:
    """Estimate the pixels that take part in a cluster, and the correspondences among them.

    Of a view of the halo there are at least as many pixels as correspond to one of its own views, at most as
    many as it has; half of those between are taken.
    """
    own, halo = list(cluster.own), list(cluster.halo)
    inside = float(graph.pixels[own].sum()), float(graph.links[own][:, own].sum()) / 2
    if not halo:
        return inside
    between, size = graph.links[own][:, halo].toarray(), graph.pixels[halo]
    shared = (between.max(axis=0) + np.minimum(between.sum(axis=0), size)) / 2
    around = graph.links[halo][:, halo].toarray() * np.minimum.outer(shared / size, shared / size)
    return inside[0] + float(shared.sum()), inside[1] + float(between.sum() + around.sum() / 2)


def typical_views(graph: ViewGraph, clusters: list[Cluster], most_pixels: float) -> Cluster:
    """Choose views from all parts of the scene, as many as there is room for; there is no halo.

    Of every cluster in turn, in an order that skips about the scene, the view with the most correspondences
    inside it and the one that has most with that; then further views that have most with those of their
    cluster that are chosen. The first two are taken whatever their size.
    """
    order = np.argsort((np.arange(len(clusters)) * GOLDEN) % 1, kind="stable")
    within = [np.array(clusters[k].own) for k in order]
    links = [graph.links[own][:, own].toarray() for own in within]
    given: list[list[int]] = [[] for _ in within]
    chosen: list[int] = []
    room = most_pixels
    while True:
        before = len(chosen)
        for own, linked, places in zip(within, links, given, strict=True):
            for place in _following(linked, places):
                view = int(own[place])
                if len(chosen) >= 2 and graph.pixels[view] > room:
                    break
                places.append(place)
                chosen.append(view)
                room -= graph.pixels[view]
        if len(chosen) == before:
            return Cluster(tuple(sorted(chosen)), ())


def _following(linked: np.ndarray, places: list[int]) -> list[int]:
    """Find the best two of a cluster's views to begin with, else the next."""
    if len(places) == len(linked):
        return []
    if not places:
        first = int(np.argmax(linked.sum(axis=1)))
        return [first, *_following(linked, [first])]
    common = linked[places].sum(axis=0)
    common[places] = -1
    return [int(np.argmax(common))]


def _divided(graph: ViewGraph, views: np.ndarray, most_pixels: float) -> tuple[list[np.ndarray], float]:
    """Divide some views; returns the parts, and the pixels that take part in the largest."""
    size, _ = size_of(Cluster.of(views, graph.links), graph)
    if len(views) < 2 or size <= most_pixels:
        return [views], size
    ordered = views[np.argsort(_fiedler_vector(graph.links[views][:, views]), kind="stable")]
    pixels = graph.pixels[ordered]
    middles = np.cumsum(pixels) - pixels / 2
    first = int(np.clip(np.searchsorted(middles, pixels.sum() / 2), 1, len(views) - 1))
    halves = [_divided(graph, half, most_pixels) for half in (ordered[:first], ordered[first:])]
    largest = max(size_of_half for _, size_of_half in halves)
    if largest <= most_pixels or largest < WORTHWHILE * size:
        return [part for parts, _ in halves for part in parts], largest
    return [views], size


def _fiedler_vector(links: sp.csr_array) -> np.ndarray:
    """Compute the second eigenvector of ``I − D^-½ W D^-½``, times ``D^-½``, W the links; (n,)."""
    weight = links.toarray().astype(np.float64)
    weight += APART * max(float(weight.max(initial=0.0)), 1.0)
    scale = 1 / np.sqrt(weight.sum(axis=1))
    laplacian = np.eye(len(weight)) - scale[:, None] * weight * scale
    vector = np.linalg.eigh(laplacian)[1][:, 1] * scale
    large = np.abs(vector) > np.abs(vector).max() / 2
    return vector * np.sign(vector[np.argmax(large)])  # eigenvectors have no sign of their own
