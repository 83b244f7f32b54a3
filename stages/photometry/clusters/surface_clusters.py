"""Clusters: parts of the surface between planes, with about equally many pixels of all views in each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline import Job, Settings
from stages.photometry.clusters.settings import ClusterSettings


@dataclass(frozen=True, eq=False)
class Cluster:
    """A part of the surface.

    Attributes
    ----------
    number : int
        Among all clusters.
    views : tuple of int
        That may see it or its margin, ascending.
    planes : ndarray, shape (k, 4), float64
        Unit normal n and offset d; without any, the part is all of the surface.
    beyond : ndarray, shape (k,), bool
        Whether the part is where ``n·x > d``, rather than where not.
    margin_px : float
        Width of the margin, in pixels of whoever sees it.
    pixels : int
        That take part, about, those of the margin included.
    """

    number: int
    views: tuple[int, ...]
    planes: np.ndarray
    beyond: np.ndarray
    margin_px: float
    pixels: int

    @classmethod
    def whole(cls, views: Sequence[int], pixels: float) -> Cluster:
        """Take all of the surface, as some views see it."""
        return cls(0, tuple(views), np.empty((0, 4)), np.empty(0, bool), 0.0, int(pixels))

    @property
    def is_whole(self) -> bool:
        """Whether all of the surface is in it."""
        return not len(self.planes)

    def owns(self, points: np.ndarray) -> np.ndarray:
        """Select the points, (n, 3), that are in the part, (n,), bool: every point is in one cluster's."""
        inside = np.ones(len(points), bool)
        for plane, beyond in zip(self.planes, self.beyond, strict=True):
            inside &= (heights(points, plane) > 0) == beyond
        return inside

    def reaches(self, points: np.ndarray, footprints: np.ndarray | float) -> np.ndarray:
        """Select the points, (n, 3), in the part or its margin, (n,), given the length of a pixel at each."""
        inside = np.ones(len(points), bool)
        for plane, beyond in zip(self.planes, self.beyond, strict=True):
            height = heights(points, plane)
            inside &= (-height if beyond else height) <= self.margin_px * footprints
        return inside

    def divided(self, plane: np.ndarray) -> tuple[Cluster, Cluster]:
        """Divide the part in two by a plane, (4,): at or below it, and beyond."""
        planes = np.vstack([self.planes, plane])
        below, above = (
            replace(self, planes=planes, beyond=np.append(self.beyond, side)) for side in (False, True)
        )
        return below, above


@dataclass(frozen=True, eq=False)
class SampledSurface:
    """Surface as the views see it.

    Attributes
    ----------
    points : ndarray, shape (m, 3), float64
        Evenly chosen pixels of all views.
    footprints : ndarray, shape (m,)
        Length of a pixel on the surface, z/f, model units.
    weights : ndarray, shape (m,)
        Pixels that each stands for.
    boxes : ndarray, shape (n, 2, 3)
        Least and greatest coordinates of all points of every view; NaN without any.
    reach : ndarray, shape (n,)
        Greatest footprint of every view.
    """

    points: np.ndarray
    footprints: np.ndarray
    weights: np.ndarray
    boxes: np.ndarray
    reach: np.ndarray

    def seeing(self, cluster: Cluster) -> tuple[int, ...]:
        """List the views whose box is not outside a cluster and its margin."""
        corners = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 3)
        points = self.boxes[:, corners, np.arange(3)]  # (n, 8, 3)
        near = np.isfinite(self.boxes).all(axis=(1, 2))
        for plane, beyond in zip(cluster.planes, cluster.beyond, strict=True):
            height = heights(points.reshape(-1, 3), plane).reshape(-1, len(corners))
            near &= (-height if beyond else height).min(axis=1) <= cluster.margin_px * self.reach
        return tuple(np.flatnonzero(near).tolist())


def heights(points: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Compute ``n·x − d`` of points, (n, 3); (n,). The same bits for a point among any others: no BLAS."""
    x, y, z = points.T
    return x * plane[0] + y * plane[1] + z * plane[2] - plane[3]


def clusters_of(surface: SampledSurface, side_px: float, how: ClusterSettings) -> list[Cluster]:
    """Divide the surface into as few clusters as keep the pixels that take part in each within bounds.

    Parameters
    ----------
    surface : SampledSurface
    side_px : float
        Mean side of the views, taken as squares.
    how : ClusterSettings

    Notes
    -----
    A part is cut across the direction in which its points extend most, at the quantile that leaves either
    side its share of the pixels. Most correspondences are then inside clusters, since a point is in the same
    one in all views; what crosses the cuts are neighbours within views.
    """
    everything = Cluster.whole(range(len(surface.boxes)), surface.weights.sum())
    undivided = replace(everything, margin_px=how.margin_px(side_px))
    clusters, largest = [everything], everything.pixels
    while largest > how.pixels:
        count = max(int(np.ceil(largest / how.pixels * len(clusters))), len(clusters) + 1)
        finer = _divided(undivided, surface, np.arange(len(surface.points)), count)
        sizes = [size_of(one, surface) for one in finer]
        if sum(sizes) > how.most_margin * everything.pixels or len(finer) == len(clusters):
            break
        clusters = [replace(one, pixels=int(size)) for one, size in zip(finer, sizes, strict=True)]
        largest = max(one.pixels for one in clusters)
    if len(clusters) == 1:
        return clusters
    return [replace(one, number=number, views=surface.seeing(one)) for number, one in enumerate(clusters)]


def size_of(cluster: Cluster, surface: SampledSurface) -> float:
    """Estimate the pixels that take part in a cluster, those of its margin included."""
    return float(surface.weights[cluster.reaches(surface.points, surface.footprints)].sum())


def tell_too_large(job: Job[Settings], clusters: Sequence[Cluster], how: ClusterSettings) -> None:
    """Warn where a cluster has more pixels than there is room for."""
    largest = max(one.pixels for one in clusters)
    if largest > how.pixels:
        job.warn(
            f"Clusters of {largest:,} pixels are taken, though there is room for {how.pixels:,}: smaller "
            "ones would be margins for the most part. More memory is needed, a narrower margin "
            f"({how.margin_in_words()}), or smaller views."
        )


def _divided(part: Cluster, surface: SampledSurface, inside: np.ndarray, count: int) -> list[Cluster]:
    """Divide a part, whose samples are given, into so many."""
    if count == 1 or len(inside) < 2:
        return [part]
    points, weights = surface.points[inside], surface.weights[inside]
    plane = _across(points, weights, (count // 2) / count)
    beyond = heights(points, plane) > 0
    below, above = part.divided(plane)
    return [
        *_divided(below, surface, inside[~beyond], count // 2),
        *_divided(above, surface, inside[beyond], count - count // 2),
    ]


def _across(points: np.ndarray, weights: np.ndarray, share: float) -> np.ndarray:
    """Find the plane, (4,), across the points' main axis that leaves a share of the weight below it."""
    middle = np.average(points, axis=0, weights=weights)
    apart = points - middle
    # einsum rather than BLAS: the same bits on any number of threads
    spread = np.einsum("p,pi,pj->ij", weights, apart, apart)
    axis = np.linalg.eigh(spread)[1][:, -1]
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])  # eigenvectors have no sign of their own
    along = heights(points, np.append(axis, 0.0))
    order = np.argsort(along, kind="stable")
    place = np.searchsorted(np.cumsum(weights[order]), share * weights.sum())
    return np.append(axis, along[order[min(int(place), len(order) - 1)]])
