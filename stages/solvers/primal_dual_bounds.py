"""How far an albedo may be from the best one under the same light: a bound from the duals."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

import stages.solvers.threading_layer  # noqa: F401
from stages.solvers.lanes import (
    clipped,
    gather_channels,
    lane_sum,
    load,
    load_channels,
    magnitude,
    spread,
    store,
    where_above,
)
from stages.solvers.sliced_graph import SlicedGraph
from stages.solvers.slices import EIGHT, ONE, QUADS, SIXTEEN, SLICE, THREE, ZERO, Blocks

UNIT = np.float32(16383)  # a dual at its bound, as it is stored: 16 bits hold twice that
DARK = (0.05, 0.1, 0.2, 0.4)  # of the mean |S|: what darker pixels say is left out; the best bound counts


@dataclass(frozen=True, eq=False)
class Bounds:
    """What an albedo costs, and what the best one costs at least, per channel, (3,) each, float64."""

    energy: np.ndarray
    least: np.ndarray

    @property
    def gap(self) -> float:
        """How far the energy, over all channels, may be above the least possible, relative to it."""
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
) -> Bounds:
    """Energy and lower bound of ``min_ρ Σ_p |I_p − S_p ρ_p| + Σ_{pq} w_pq |ρ_p − ρ_q|``.

    Parameters
    ----------
    blocks, graph, edge_dual, image, shading, share
        As in `PrimalDual` and `Problem`.
    albedo : ndarray, shape (S · 8, 4), float32
        Interleaved: four numbers per pixel.
    multiplier : ndarray, shape (n, 3), float64
        m, of every view's gauge: the minimum is over the albedos with ``Σ share |ρ| = wanted``. With m = 0 it
        is over all.
    kept : ndarray, shape (3,), float64
        ``Σ m · wanted`` over the gauges.

    Notes
    -----
    For duals within ±w, and albedos between the least and the greatest I/S, ``[a, b]``,
    ``E ≥ Σ_p min_{a ≤ v ≤ b} (|I_p − S_p v| + (Kᵀy)_p v − m share_p |v|) + kept``,
    whose minima are at a, at b, or at I/S. Without a gauge the best albedo lies in that range. Of the
    darkest pixels, whose I/S would make it endless, only ``|I| − |S| max(|a|, |b|)`` is counted where it is
    positive: a little less than they cost.
    """
    floors = np.outer(np.array(DARK, np.float32), _mean_size(shading))
    ranges = np.empty((blocks.view.size, len(DARK), 3, 2), np.float32)
    _ranges_of_quotients(blocks.begin, blocks.end, image, shading, floors, ranges)
    quotients = np.stack([ranges[..., 0].min(axis=0), ranges[..., 1].max(axis=0)], axis=-1)
    quotients[quotients[..., 0] > quotients[..., 1]] = 0  # a channel without light
    sums = np.zeros((blocks.view.size, 3, 1 + len(DARK)))
    _bounds(
        (blocks.view, blocks.begin, blocks.end),
        (graph.first, graph.neighbour, graph.weight),
        edge_dual,
        albedo.ravel(),
        (image.ravel(), shading.ravel(), share.ravel()),
        multiplier.astype(np.float32),
        floors,
        quotients,
        sums,
    )
    totals = sums.sum(axis=0)
    return Bounds(totals[:, 0], totals[:, 1:].max(axis=1) + kept)


def _mean_size(shading: np.ndarray) -> np.ndarray:
    """Mean |S| of every channel, (3,), float32, of the pixels that are not black."""
    counts = np.maximum(np.count_nonzero(shading, axis=(0, 2)), 1)
    return (np.abs(shading).sum(axis=(0, 2), dtype=np.float64) / counts).astype(np.float32)


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def _ranges_of_quotients(begins, ends, image, shading, floors, ranges):
    """Least and greatest I/S of every block, threshold and channel, where |S| is above the threshold."""
    for block in numba.prange(begins.size):
        for c in range(3):
            ranges[block, :, c, 0], ranges[block, :, c, 1] = np.inf, -np.inf
            for s in range(begins[block], ends[block]):
                for lane in range(8):
                    light = shading[s, c, lane]
                    quotient = image[s, c, lane] / light
                    for k in range(floors.shape[0]):
                        if abs(light) > floors[k, c]:
                            ranges[block, k, c, 0] = min(ranges[block, k, c, 0], quotient)
                            ranges[block, k, c, 1] = max(ranges[block, k, c, 1], quotient)


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def _bounds(blocks, graph, dual, albedo, givens, multiplier, floors, quotients, sums):
    """Energy, then a bound for every threshold of darkness, summed over the slices of a block."""
    views, begins, ends = blocks
    first, neighbour, weight = graph
    image, shading, share = givens
    for block in numba.prange(begins.size):
        made = np.empty(THREE * SLICE, np.float32)
        for s in range(np.uint64(begins[block]), np.uint64(ends[block])):
            _look_along_edges(s, first, neighbour, weight, dual, albedo, made)
            for c in range(THREE):
                at = s * SLICE + c * EIGHT
                light, value = load(shading, at), load(image, at)
                rho, variation, pull = _three(made, c * EIGHT)
                gain = spread(multiplier[views[block], c]) * load(share, s * EIGHT)
                sums[block, c, 0] += lane_sum(magnitude(value - light * rho) + variation)
                for k in range(floors.shape[0]):
                    least = _least(value, light, pull, gain, floors[k, c], quotients[k, c])
                    sums[block, c, 1 + k] += lane_sum(least)


@numba.njit(nogil=True)
def _look_along_edges(s, first, neighbour, weight, dual, albedo, made):
    """Of a slice: albedo, half of ``Σ w |ρ_p − ρ_q|``, and ``Kᵀy``, three channels each."""
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
def _least(value, light, pull, gain, floor, quotients):
    """What the pixels of a slice cost at least; those darker than `floor` count as the Notes above say."""
    zero, one = spread(np.float32(0)), spread(np.float32(1))
    low, high, dark = spread(quotients[0]), spread(quotients[1]), spread(floor)
    fit = where_above(magnitude(light), dark, value / light, low)
    heard = where_above(magnitude(light), dark, one, zero)
    reach = magnitude(light) * spread(max(abs(quotients[0]), abs(quotients[1])))
    unlit = magnitude(value) - clipped(reach, magnitude(value))
    lit, seen = heard * light, heard * value
    least = _cost(fit, seen, lit, pull, gain)
    for end in (low, high):
        there = _cost(end, seen, lit, pull, gain)
        least = least - where_above(least, there, least - there, zero)
    return least + (one - heard) * unlit


@numba.njit(inline="always")
def _cost(albedo, value, light, pull, gain):
    return magnitude(value - light * albedo) + pull * albedo - gain * magnitude(albedo)
