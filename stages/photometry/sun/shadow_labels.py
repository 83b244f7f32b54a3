"""How much of a sun the pixels of a view see, by graph cuts: shadows of what was not reconstructed, too."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from stages.photometry.sun.choice_kernels import pair_costs
from stages.photometry.sun.settings import ShadowSettings

ALONG = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows and columns from a pixel to its partners, at distance 1
UNIT = 4000  # of a maximum flow, which is found in integers, per pixel
ENOUGH = 20_000  # pairs, for a median

Scales = list[tuple[float, float]]  # of brightness and of chromaticity, for every distance


@dataclass(frozen=True, eq=False)
class SunlitView:
    """A view's pixels, (h, w), under a sun and all other light.

    Attributes
    ----------
    shaded : ndarray, shape (h, w, 3), float32
        Log albedo in full shadow.
    gain : ndarray, shape (h, w, 3), float32
        Irradiance by the sun over that by all other light.
    weight : ndarray, shape (h, w), float32
        Reliability, 0 to 1; 0 outside the mask.
    free : ndarray, shape (h, w), bool
        The sun may reach the pixel, as far as the mesh is known.
    side : float
        Mean side of whole views, taken as squares, px: these pixels may be cut out of one.
    """

    shaded: np.ndarray
    gain: np.ndarray
    weight: np.ndarray
    free: np.ndarray
    side: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.free.shape[0], self.free.shape[1]

    @property
    def sure(self) -> np.ndarray:
        """Pixels, (h, w), bool, that the sun may reach and whose intensity says something."""
        return self.free & (self.weight > 0)

    def albedo(self, seen: np.ndarray) -> np.ndarray:
        """Compute the log albedo where a share of the sun, (h, w), is seen: (h, w, 3)."""
        return self.shaded - np.log1p(seen[..., None] * self.gain)

    def halved(self) -> SunlitView:
        """Average squares of four pixels; free where half of their weight is."""
        total = _sum_of_four(self.weight)
        own = np.maximum(total, np.float32(1e-9))
        shaded, gain = (
            _sum_of_four(values * self.weight[..., None]) / own[..., None]
            for values in (self.shaded, self.gain)
        )
        free = _sum_of_four(self.weight * self.free) > own / 2
        return SunlitView(shaded, gain, total / 4, free, self.side / 2)


def sun_seen(view: SunlitView, scales: Scales, how: ShadowSettings) -> np.ndarray:
    """Find the share of a sun that each pixel sees, (h, w), float32: from coarse to fine, by minimum cuts.

    Notes
    -----
    Shares m of a few levels minimise ``Σ_pq w_pq u/(1 + u) + edge Σ_pq |a_p − a_q| + shade Σ_p (1 − m_p)``:
    pairs of pixels at several distances should agree in albedo, ``u = μ²/s² + ν/t²`` with μ and ν the
    channels' mean and variance of the difference of their log albedos, and s and t what is usual at that
    distance (`texture_scales`). A pair of different paints disagrees whatever its shadows and says nothing.
    Where the mesh hides the sun, the share is known: 0. Elsewhere a = 1 − m is added shadow, whose outline
    has its price, also where it meets a shadow of the mesh: else stains would grow on these.

    Level by level all pixels choose between theirs and that one, which is a minimum cut where
    ``E(0,0) + E(1,1) ≤ E(0,1) + E(1,0)`` (Boykov, Veksler and Zabih, Fast Approximate Energy Minimization via
    Graph Cuts, 2001); where a pair's costs are not so, the dearer of its unlike choices is made dearer. A
    finer grid decides only the pixels beside the borders of the coarser one.
    """
    known = view.free.astype(np.float32)
    if view.side >= 2 * how.coarsest_side:
        rows, columns = view.shape
        half = view.halved()
        coarse = sun_seen(half, texture_scales(half, how), how)
        seen = coarse.repeat(2, axis=0).repeat(2, axis=1)[:rows, :columns] * view.free
        seen = _chosen(view, seen, known, _border(seen, view.sure, how.margin), (0.0, 1.0), scales, how)
    else:
        seen = _chosen(view, known, known, view.sure, (0.0,), scales, how)
    beside = _border(seen, view.sure, _cells(how.penumbra_width, view.side))
    return _chosen(view, seen, known, beside, how.penumbra, scales, how)


def edges_decided(
    view: SunlitView,
    seen: np.ndarray,
    by_mesh: np.ndarray,
    among: np.ndarray,
    scales: Scales,
    how: ShadowSettings,
) -> np.ndarray:
    """Decide anew how much pixels beside the edges of known shadows see of a sun.

    Mesh and sun are known to some pixels: what rays say of these is no more than likely. What sees another
    share of the sun than the mesh lets through pays for its outline, as a shadow does.

    Parameters
    ----------
    view : SunlitView
        The sun is hidden by nothing.
    seen : ndarray, shape (h, w), float32
        Share of it, 0 to 1.
    by_mesh : ndarray, shape (h, w), float32
        Share of it that the mesh lets through.
    among : ndarray, shape (h, w), bool
        Beside an edge.
    scales : list
        Of `texture_scales`.
    how : ShadowSettings

    Returns
    -------
    ndarray, shape (h, w), float32
    """
    levels = (0.0, 1.0, *how.penumbra)
    return _chosen(view, seen, by_mesh, among & (view.weight > 0), levels, scales, how)


def beside_edges(seen: np.ndarray, mask: np.ndarray, side: float, how: ShadowSettings) -> np.ndarray:
    """Find the pixels of a mask, (h, w), bool, beside edges of what the mesh lets see of a sun, (h, w).

    `side`: that of `SunlitView`.
    """
    return _border(seen, mask, _cells(how.uncertain_width, side))


def _cells(share: float, side: float) -> int:
    return max(1, round(share * side))


def texture_scales(view: SunlitView, how: ShadowSettings) -> Scales:
    """Measure the usual difference of log albedo at each distance, of reliable pixels that may be lit."""
    albedo = view.albedo(view.free.astype(np.float32))
    scales: Scales = []
    for distance in how.distances:
        differences = [
            _differences(albedo, view.sure, distance * down, distance * right) for down, right in ALONG[:2]
        ]
        off = np.concatenate(differences)
        mean = off.mean(axis=1)
        chroma = np.sqrt(((off - mean[:, None]) ** 2).mean(axis=1))
        brightness, colour = (how.texture * _median(each) for each in (np.abs(mean), chroma))
        scales.append((max(brightness, how.least_step), max(colour, how.least_chroma_step)))
    return scales


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else 0.0


def _differences(albedo: np.ndarray, free: np.ndarray, down: int, right: int) -> np.ndarray:
    """Subtract the log albedos of free pixels so far apart, (m, 3); of many pairs, some."""
    rows, columns = free.shape
    one = slice(0, max(rows - down, 0)), slice(0, max(columns - right, 0))
    two = slice(down, rows), slice(right, columns)
    pairs = np.flatnonzero(free[one] & free[two])
    pairs = pairs[:: max(1, len(pairs) // ENOUGH)]
    return albedo[one].reshape(-1, 3)[pairs] - albedo[two].reshape(-1, 3)[pairs]


def _border(seen: np.ndarray, free: np.ndarray, margin: int) -> np.ndarray:
    """Find the pixels, (h, w), bool, that are so near to others which see more or less, of those free to."""
    around = np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)
    most, least = np.where(free, seen, np.float32(0)), np.where(free, seen, np.float32(1))
    return free & (cv2.dilate(most, around) > cv2.erode(least, around))


def _chosen(
    view: SunlitView,
    seen: np.ndarray,
    known: np.ndarray,
    among: np.ndarray,
    levels: tuple[float, ...],
    scales: Scales,
    how: ShadowSettings,
) -> np.ndarray:
    """Let pixels, (h, w), bool, choose between what they see and every level in turn.

    What differs from `known`, (h, w), the share that the mesh lets through, has its price.
    """
    for level in levels:
        other = np.where(among, np.float32(level), seen)
        changeable = other != seen
        if changeable.any():
            changed = minimum_cut(Choice.between(view, seen, other, known, changeable, scales, how))
            seen = seen.copy()
            seen[changeable] = np.where(changed, np.float32(level), seen[changeable])
    return seen


def _sum_of_four(values: np.ndarray) -> np.ndarray:
    rows, columns = values.shape[0], values.shape[1]
    even = np.pad(values, [(0, rows % 2), (0, columns % 2)] + [(0, 0)] * (values.ndim - 2))
    return even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]


@dataclass(frozen=True, eq=False)
class Choice:
    """Costs of a choice that n pixels have between staying and changing.

    Attributes
    ----------
    change : ndarray, shape (n,)
        Of changing, alone; below 0 if that is cheaper.
    first, second : ndarray, shape (m,)
        Pairs of these pixels.
    unlike : ndarray, shape (m,)
        If the first stays and the second changes; at least 0.
    """

    change: np.ndarray
    first: np.ndarray
    second: np.ndarray
    unlike: np.ndarray

    @classmethod
    def between(
        cls,
        view: SunlitView,
        seen: np.ndarray,
        other: np.ndarray,
        known: np.ndarray,
        free: np.ndarray,
        scales: Scales,
        how: ShadowSettings,
    ) -> Choice:
        """Add up the costs of all pairs of which a pixel may change; `known`, (h, w): what the mesh says."""
        albedo = np.stack([view.albedo(seen), view.albedo(other)])
        added = np.abs(known - np.stack([seen, other]))
        weight = view.weight / np.sqrt(np.float32(len(ALONG) * len(how.distances)))
        change = how.shade * (added[1] - added[0]).astype(np.float64)
        unlike = np.empty(view.shape, np.float32)
        number = np.cumsum(free, dtype=np.int32).reshape(free.shape) - 1
        pairs = []
        for distance, (step, chroma_step) in zip(how.distances, scales, strict=True):
            edge = how.edge * len(how.distances) if distance == min(how.distances) else 0.0
            for down, right in ((distance * down, distance * right) for down, right in ALONG):
                where = albedo, added, weight, free, down, right
                pair_costs(*where, edge, step, chroma_step, change, unlike)
                rows, columns = np.nonzero(unlike)
                first, second = number[rows, columns], number[rows + down, columns + right]
                pairs.append((first, second, unlike[rows, columns]))
        return cls(change[free], *(np.concatenate(part) for part in zip(*pairs, strict=True)))


def minimum_cut(choice: Choice) -> np.ndarray:
    """Find which pixels change, (n,), bool, at the least cost, in integers."""
    count = len(choice.change)
    source, sink, every = count, count + 1, np.arange(count)
    begin = np.concatenate([np.full(count, source), every, choice.second])
    end = np.concatenate([every, np.full(count, sink), choice.first])
    cost = np.concatenate([np.maximum(-choice.change, 0), np.maximum(choice.change, 0), choice.unlike])
    cost = np.rint(UNIT * cost).astype(np.int32)
    paid = cost > 0
    graph = sp.coo_array((cost[paid], (begin[paid], end[paid])), shape=(count + 2, count + 2)).tocsr()
    left = graph - maximum_flow(graph, source, sink).flow
    left.data[left.data < 0] = 0
    left.eliminate_zeros()
    reached = np.zeros(count + 2, bool)
    reached[breadth_first_order(left, source, return_predecessors=False)] = True
    return reached[:count]
