"""Views from all parts of a scene, by its graph of views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

GOLDEN = (5**0.5 - 1) / 2
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
    def starts(self) -> np.ndarray:
        """Number of masked pixels in the views before each, (n,), int64."""
        return np.cumsum(self.pixels) - self.pixels

    @property
    def links_per_pixel(self) -> float:
        """Mean number of correspondences per pixel."""
        return float(self.links.sum()) / max(int(self.pixels.sum()), 1)


def typical_views(graph: ViewGraph, most_pixels: float) -> tuple[int, ...]:
    """Choose views from all parts of the scene, as many as there is room for; ascending.

    Of every part in turn, in an order that skips about the scene, the view with the most correspondences
    inside it and the one that has most with that; then further views that have most with those of their
    part that are chosen. The first two are taken whatever their size.
    """
    parts = parts_of(graph, most_pixels)
    order = np.argsort((np.arange(len(parts)) * GOLDEN) % 1, kind="stable")
    within = [parts[k] for k in order]
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
            return tuple(sorted(chosen))


def parts_of(graph: ViewGraph, most_pixels: float) -> list[np.ndarray]:
    """Divide all views into parts of no more pixels than asked, but one view at least, by bisection.

    Each is divided into two with about equally many pixels, in the order of the Fiedler vector of its
    normalised Laplacian (Shi and Malik 2000), so that few correspondences are cut.
    """
    return sorted(_divided(graph, np.arange(len(graph.pixels)), most_pixels), key=min)


def _following(linked: np.ndarray, places: list[int]) -> list[int]:
    """Find the best two of a part's views to begin with, else the next."""
    if len(places) == len(linked):
        return []
    if not places:
        first = int(np.argmax(linked.sum(axis=1)))
        return [first, *_following(linked, [first])]
    common = linked[places].sum(axis=0)
    common[places] = -1
    return [int(np.argmax(common))]


def _divided(graph: ViewGraph, views: np.ndarray, most_pixels: float) -> list[np.ndarray]:
    if len(views) < 2 or graph.pixels[views].sum() <= most_pixels:
        return [views]
    ordered = views[np.argsort(_fiedler_vector(graph.links[views][:, views]), kind="stable")]
    pixels = graph.pixels[ordered]
    middles = np.cumsum(pixels) - pixels / 2
    first = int(np.clip(np.searchsorted(middles, pixels.sum() / 2), 1, len(views) - 1))
    return [
        part for half in (ordered[:first], ordered[first:]) for part in _divided(graph, half, most_pixels)
    ]


def _fiedler_vector(links: sp.csr_array) -> np.ndarray:
    """Compute the second eigenvector of ``I − D^-½ W D^-½``, times ``D^-½``, W the links; (n,)."""
    weight = links.toarray().astype(np.float64)
    weight += APART * max(float(weight.max(initial=0.0)), 1.0)
    scale = 1 / np.sqrt(weight.sum(axis=1))
    laplacian = np.eye(len(weight)) - scale[:, None] * weight * scale
    vector = np.linalg.eigh(laplacian)[1][:, 1] * scale
    large = np.abs(vector) > np.abs(vector).max() / 2
    return vector * np.sign(vector[np.argmax(large)])  # eigenvectors have no sign of their own
