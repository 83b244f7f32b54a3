"""Duality gap of an albedo under a fixed light: an upper bound of its excess energy."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.solvers.kernels.interleaved_pixels import gather_channels, load_channels
from stages.solvers.kernels.simd import (
    clipped,
    lane_sum,
    load,
    magnitude,
    spread,
    store,
    where_above,
)
from stages.solvers.kernels.sliced_ellpack import EIGHT, ONE, QUADS, SIXTEEN, SLICE, THREE, ZERO, Blocks
from stages.solvers.primal_dual.sliced_graph import SlicedGraph

UNIT = np.float32(16383)  # a dual of 1, as stored: 16 bits hold twice that


@dataclass(frozen=True, eq=False)
class Bounds:
    """Energy of an albedo, and lower bound of the least energy, per channel, (3,) each, float64.

    In a gauge, the least is over the albedos within the range of the tightest bound (see `bounds`).
    """

    energy: np.ndarray
    least: np.ndarray

    @property
    def gap(self) -> float:
        """Upper bound of the excess over the least energy, all channels together, relative to the energy."""
        energy, least = float(self.energy.sum()), float(self.least.sum())
        return (energy - least) / energy if energy > 0 else 0.0


def bounds(
    blocks: Blocks,
    graph: SlicedGraph,
    edge_dual: np.ndarray,
    albedo: np.ndarray,
    image: np.ndarray,
    shading: np.ndarray,
    share: np.ndarray,
    multiplier: np.ndarray,
    kept: np.ndarray,
    widths: tuple[float, ...],
) -> Bounds:
    """Evaluate energy and lower bound of ``min_ρ Σ_p |I_p − S_p ρ_p| + Σ_{pq} w_pq |ρ_p − ρ_q|``.

    Parameters
    ----------
    blocks, graph, edge_dual, image, shading, share
        As in `PrimalDual` and `Problem`.
    albedo : ndarray, shape (S · 8, 4), float32
        Interleaved: four numbers per pixel.
    multiplier : ndarray, shape (n, 3), float64
        m, of every view's gauge: the minimum is over the albedos with ``Σ share |ρ| = wanted``; for m = 0,
        over all.
    kept : ndarray, shape (3,), float64
        ``Σ m · wanted`` over the gauges.
    widths : tuple of float
        The ranges of albedo to try, in units of the current one, about its middle; that of all I/S is added.

    Notes
    -----
    For duals within ±w, and any range ``[a, b]``,
    ``E ≥ Σ_p min_{a ≤ v ≤ b} (|S_p| |q_p − v| + (Kᵀy)_p v − m share_p |v|) + kept``,
    with q the quotient I/S clipped to the range. The minima are at a, at b, or at q; where S = 0 the data
    cost |I|. Proof: clipping an albedo lowers its variation, and its misfit to the clipped image is no
    greater than that to the image. So without a gauge the bound holds for every albedo; in a gauge, for those
    within the range. Narrow ranges reduce the cost of unbalanced duals, with a pull beyond ±S; wide ones
    clip less. The tightest of several bounds is used, from the range of the current albedo to that of all
    I/S, which a few dark pixels can make arbitrarily wide.
    """
    found = np.empty((blocks.view.size, 2, 3, 2), np.float32)
    _ranges(blocks.begin, blocks.end, albedo, image, shading, share, found)
    of_albedo, of_quotients = np.stack([found[..., 0].min(axis=0), found[..., 1].max(axis=0)], axis=-1)
    ranges = _widened(of_albedo, of_quotients, widths)
    sums = np.zeros((blocks.view.size, 3, 1 + len(ranges)))
    _bounds(
        (blocks.view, blocks.begin, blocks.end),
        (graph.first, graph.neighbour, graph.weight),
        edge_dual,
        albedo.ravel(),
        (image.ravel(), shading.ravel(), share.ravel()),
        multiplier.astype(np.float32),
        ranges,
        sums,
    )
    totals = sums.sum(axis=0)
    return Bounds(totals[:, 0], totals[:, 1:].max(axis=1) + kept)


def _widened(of_albedo: np.ndarray, of_quotients: np.ndarray, widths: tuple[float, ...]) -> np.ndarray:
    """List the ranges to try, (R, 3, 2), float32."""
    # Ranges are not finite without pixels, or for a channel with no or hardly any light.
    found, quotients = (
        np.where(np.isfinite(ends).all(axis=-1, keepdims=True), ends, np.float32(0))
        for ends in (of_albedo, of_quotients)
    )
    half = (found[:, 1:] - found[:, :1]) / 2 * np.array([-1, 1], np.float32)
    return np.stack([*(found + np.float32(width - 1) * half for width in widths), quotients])


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def _ranges(begins, ends, albedo, image, shading, share, ranges):
    """Compute the ranges of the albedo, then of I/S, of every block and channel."""
    for block in numba.prange(begins.size):
        ranges[block, :, :, 0], ranges[block, :, :, 1] = np.inf, -np.inf
        for s in range(begins[block], ends[block]):
            for lane in range(8):
                if share[s, 0, lane] == 0:
                    continue
                for c in range(3):
                    _reach(ranges[block, 0, c], albedo[s * 8 + lane, c])
                    if shading[s, c, lane] != 0:
                        _reach(ranges[block, 1, c], image[s, c, lane] / shading[s, c, lane])


@numba.njit(inline="always")
def _reach(range_, value):
    range_[0], range_[1] = min(range_[0], value), max(range_[1], value)


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def _bounds(blocks, graph, dual, albedo, givens, multiplier, ranges, sums):
    """Sum the energy, then the bound of every range, over the slices of a block."""
    views, begins, ends = blocks
    first, neighbour, weight = graph
    image, shading, share = givens
    for block in numba.prange(begins.size):
        made = np.empty(THREE * SLICE, np.float32)
        for s in range(np.uint64(begins[block]), np.uint64(ends[block])):
            _sum_along_edges(s, first, neighbour, weight, dual, albedo, made)
            for c in range(THREE):
                at = s * SLICE + c * EIGHT
                light, value = load(shading, at), load(image, at)
                rho, variation, pull = _three(made, c * EIGHT)
                gain = spread(multiplier[views[block], c]) * load(share, s * EIGHT)
                sums[block, c, 0] += lane_sum(magnitude(value - light * rho) + variation)
                for k in range(ranges.shape[0]):
                    sums[block, c, 1 + k] += lane_sum(_least(value, light, pull, gain, ranges[k, c]))


@numba.njit(nogil=True)
def _sum_along_edges(s, first, neighbour, weight, dual, albedo, made):
    """Sum along a slice's edges: albedo, half of ``Σ w |ρ_p − ρ_q|``, and ``Kᵀy``, three channels each."""
    unit = spread(UNIT)
    red, green, blue = load_channels(albedo, s * QUADS)
    vary_red, vary_green, vary_blue = spread(np.float32(0)), spread(np.float32(0)), spread(np.float32(0))
    pull_red, pull_green, pull_blue = spread(np.float32(0)), spread(np.float32(0)), spread(np.float32(0))
    for row in range(first[s], first[s + ONE]):
        w, held = load(weight, row * EIGHT), row * SLICE
        far_red, far_green, far_blue = gather_channels(albedo, neighbour, row * EIGHT)
        vary_red = vary_red + w * magnitude(red - far_red)
        vary_green = vary_green + w * magnitude(green - far_green)
        vary_blue = vary_blue + w * magnitude(blue - far_blue)
        pull_red = pull_red + w * clipped(load(dual, held), unit)
        pull_green = pull_green + w * clipped(load(dual, held + EIGHT), unit)
        pull_blue = pull_blue + w * clipped(load(dual, held + SIXTEEN), unit)
    half, whole = spread(np.float32(0.5)), spread(np.float32(1) / UNIT)
    _store_three(made, ZERO, red, half * vary_red, whole * pull_red)
    _store_three(made, EIGHT, green, half * vary_green, whole * pull_green)
    _store_three(made, SIXTEEN, blue, half * vary_blue, whole * pull_blue)


@numba.njit(inline="always")
def _store_three(made, at, albedo, variation, pull):
    store(made, at, albedo)
    store(made, at + SLICE, variation)
    store(made, at + SLICE + SLICE, pull)


@numba.njit(inline="always")
def _three(made, at):
    return load(made, at), load(made, at + SLICE), load(made, at + SLICE + SLICE)


@numba.njit(inline="always")
def _least(value, light, pull, gain, ends):
    """Bound the cost of a slice's pixels, by the formula in the Notes of `bounds`."""
    zero, one = spread(np.float32(0)), spread(np.float32(1))
    low, high, size = spread(ends[0]), spread(ends[1]), magnitude(light)
    fit = value / where_above(size, zero, light, one)
    fit = where_above(fit, high, high, where_above(low, fit, low, fit))
    least = pull * fit - gain * magnitude(fit)
    for end in (low, high):
        there = size * magnitude(fit - end) + pull * end - gain * magnitude(end)
        least = least - where_above(least, there, least - there, zero)
    return least + where_above(size, zero, zero, magnitude(value))
