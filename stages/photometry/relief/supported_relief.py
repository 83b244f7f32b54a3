"""The share of a mesh's relief that the photos support: what they contradict is noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stages.photometry.relief.settings import ReliefSettings
from stages.photometry.relief.vertex_smoothing import VertexSmoothing
from stages.solvers.kernels.unit_vectors import as_unit

CORNERS = 8  # of a cube


@dataclass(frozen=True, eq=False)
class Photo:
    """What all photos show at the vertices of a mesh.

    Attributes
    ----------
    logs : ndarray, shape (V,)
        Logarithm of the radiance.
    known : ndarray, shape (V,), bool
        Vertices that some photo shows.
    """

    logs: np.ndarray
    known: np.ndarray


def supported_normals(
    levels: Sequence[np.ndarray],
    smoothing: VertexSmoothing,
    cubes: Sequence[Cubes],
    photo: Photo,
    log_shading: Callable[[np.ndarray], np.ndarray],
    how: ReliefSettings,
) -> tuple[np.ndarray, list[float]]:
    """Weaken each band of relief to what the photos support.

    Parameters
    ----------
    levels : sequence of ndarray, shape (V, 3), float32
        Unit normals of the mesh's vertices, at every level of the smoothing.
    smoothing : VertexSmoothing
    cubes : sequence of Cubes
        In which a band is supported or not, for every band.
    photo : Photo
    log_shading : callable
        Computes the logarithm of the vertices' shading, (V,), from other unit normals.
    how : ReliefSettings

    Returns
    -------
    tuple of ndarray, shape (V, 3), float32, and list of float
        Unit normals, and the median share of every band at known vertices, fine to coarse.

    Notes
    -----
    A band is the difference between two levels' normals. Relief shades the photos; what stereo or a scanner
    made up does not, and shading that has it would press its negative into the albedo. From coarse to fine,
    let r be what the photo has beyond the shading of all coarser relief, and s what the band changes in that
    shading, both selected by one filter: so shadows that both have are in neither. The share c of the
    band around a vertex minimises ``Σ φ((r − c s) / t) + price (1 − c)``, ``φ(u) = u²/(1 + u²)``, t by the
    median ``|r|``: a line through the origin, fitted so that paint and edges of shadows are outliers. Noise
    that the photo does not have gives 0, relief 1; between, c is what a Wiener filter leaves of both. No
    light is needed but a rough one, and all views take part.
    """
    found, medians = levels[-1], []
    for number in reversed(range(len(levels) - 1)):
        band = levels[number] - levels[number + 1]
        before = log_shading(as_unit(found))
        changed = log_shading(as_unit(found + band)) - before
        left, own = (smoothing.band(values, photo.known, number) for values in (photo.logs - before, changed))
        share = _supported_share(left, own, photo.known, cubes[number], how)
        found = found + share[:, None] * band
        medians.append(float(np.median(share[photo.known])) if photo.known.any() else 1.0)
    return as_unit(found), medians[::-1]


def _supported_share(
    photo: np.ndarray, shading: np.ndarray, known: np.ndarray, cubes: Cubes, how: ReliefSettings
) -> np.ndarray:
    """Find the share, (V,), of a band of shading, (V,), that is in the photo's, (V,)."""
    shares, some = np.array(how.shares), int(np.count_nonzero(known))
    if not some:
        return np.ones(len(photo), np.float32)
    usual = how.outlier * float(np.median(np.abs(photo[known]))) + np.finfo(np.float32).tiny
    costs = []
    for share in how.shares:
        off = np.square((photo - share * shading) / usual)
        cost = np.where(known, off / (1 + off) + how.price * (1 - share), 0)
        costs.append(cubes.sums(cost) + how.shared * float(cost.sum()) / some)
    return cubes.interpolated(_least(np.stack(costs), shares))


def _least(costs: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Find where the cost, known at some ascending values: (k, n), is least: by a parabola, (n,)."""
    best = np.clip(np.argmin(costs, axis=0), 1, len(at) - 2) if len(at) > 2 else np.argmin(costs, axis=0)
    if len(at) == 2:
        return at[best]
    column = np.arange(costs.shape[1])
    before, here, after = (costs[best + step, column] for step in (-1, 0, 1))
    low, middle, high = (at[best + step] for step in (-1, 0, 1))
    slopes = (here - before) / (middle - low), (after - here) / (high - middle)
    bend = (slopes[1] - slopes[0]) / (high - low)
    lowest = (low + middle) / 2 - slopes[0] / (2 * np.where(bend > 0, bend, 1))
    ends = np.where(before <= after, low, high)
    return np.clip(np.where(bend > 0, lowest, ends), low, high)


@dataclass(frozen=True, eq=False)
class Cubes:
    """A grid of cubes over points, of which only those around points exist; trilinear.

    Attributes
    ----------
    corner : ndarray, shape (n, 8)
        Which corners of cubes are around each point.
    weight : ndarray, shape (n, 8), float32
        Sums to 1.
    count : int
        Of all corners.
    """

    corner: np.ndarray
    weight: np.ndarray
    count: int

    @classmethod
    def of(cls, places: np.ndarray, side: float) -> Cubes:
        """Lay cubes of a side over points, (n, 3)."""
        at = (places - places.min(axis=0)) / side
        first = np.floor(at).astype(np.int64)
        rest, size = (at - first).astype(np.float32), first.max(axis=0) + 2
        number = np.empty((len(places), CORNERS), np.int64)
        weight = np.empty((len(places), CORNERS), np.float32)
        for corner in range(CORNERS):
            step = np.array([corner & 1, corner >> 1 & 1, corner >> 2])
            x, y, z = (first + step).T
            number[:, corner] = (x * size[1] + y) * size[2] + z
            weight[:, corner] = np.where(step, rest, 1 - rest).prod(axis=1)
        there, corners = np.unique(number, return_inverse=True)
        return cls(corners.reshape(number.shape), weight, len(there))

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Sum up values at the points, (n,), around every corner, (count,)."""
        weighted = (self.weight * values[:, None]).ravel()
        return np.bincount(self.corner.ravel(), weighted, minlength=self.count)

    def interpolated(self, values: np.ndarray) -> np.ndarray:
        """Interpolate values of the corners, (count,), at the points: (n,), float32."""
        return np.einsum("nk,nk->n", self.weight, values[self.corner]).astype(np.float32)
