"""The compiled loops of `PrimalDual`: an iteration, the shading, the duals of a coarser level."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.threading_layer  # noqa: F401
from stages.solvers.lanes import clipped, gather, lane_sum, load, magnitude, spread, store
from stages.solvers.primal_dual_bounds import UNIT

EIGHT, SIXTEEN, SLICE = np.uint64(8), np.uint64(16), np.uint64(24)  # a slice: three channels of eight pixels
ONE, THREE = np.uint64(1), np.uint64(3)
TWICE = np.float32(2) * UNIT  # what 16 bits hold


@numba.njit(parallel=True, cache=True, nogil=True)
def shade(views, begins, ends, basis, light, shading):
    """``S = σ·ν`` of every slice and channel."""
    for block in numba.prange(views.size):
        for s in range(np.uint64(begins[block]), np.uint64(ends[block])):
            for c in range(THREE):
                store(shading, (s * THREE + c) * EIGHT, _shaded(basis, s, light[views[block], c]))


@numba.njit(inline="always")
def _shaded(basis, s, light):
    """``σ·ν`` of a slice."""
    size = np.uint64(light.size)
    total = spread(np.float32(0))
    for k in range(size):
        total = total + spread(light[k]) * load(basis, (s * size + k) * EIGHT)
    return total


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def sweep(blocks, graph, duals, albedos, givens, lights, multiplier, steps, slopes, pulls):
    """One iteration, in place but for the albedo ahead, which neighbours still read.

    Unsigned places throughout: numba checks signed ones for negative values.
    """
    views, begins, ends = blocks
    first, neighbour, weight, total_weight = graph
    edge_dual, data_dual = duals
    albedo, ahead, ahead_next = albedos
    image, basis, share = givens
    light, light_ahead = lights
    scale, data_share, relaxation = steps
    gain, unit, twice = spread(np.float32(0.5) * UNIT / scale), spread(UNIT), spread(TWICE)
    data_gain, kappa = spread(np.float32(0.5) * data_share / scale), spread(data_share)
    theta, r, pull_scale = spread(relaxation), spread(scale), spread(np.float32(1) / UNIT)
    zero, one, two = spread(np.float32(0)), spread(np.float32(1)), spread(np.float32(2))
    size = np.uint64(light.shape[2])
    for block in numba.prange(views.size):
        view = views[block]
        slope = np.zeros(THREE * size * EIGHT, np.float32)
        pulled = np.zeros(THREE * EIGHT, np.float32)
        for s in range(np.uint64(begins[block]), np.uint64(ends[block])):
            red, green, blue = s * SLICE, s * SLICE + EIGHT, s * SLICE + SIXTEEN
            own_red, own_green, own_blue = load(ahead, red), load(ahead, green), load(ahead, blue)
            pull_red, pull_green, pull_blue = zero, zero, zero
            for row in range(first[s], first[s + ONE]):
                at, held = row * EIGHT, row * SLICE
                w = load(weight, at)
                z = load(edge_dual, held)
                z = _moved(z, own_red - gather(ahead, np.uint64(0), neighbour, at), gain, theta, unit, twice)
                store(edge_dual, held, z)
                pull_red = pull_red + w * z
                z = load(edge_dual, held + EIGHT)
                z = _moved(z, own_green - gather(ahead, EIGHT, neighbour, at), gain, theta, unit, twice)
                store(edge_dual, held + EIGHT, z)
                pull_green = pull_green + w * z
                z = load(edge_dual, held + SIXTEEN)
                z = _moved(z, own_blue - gather(ahead, SIXTEEN, neighbour, at), gain, theta, unit, twice)
                store(edge_dual, held + SIXTEEN, z)
                pull_blue = pull_blue + w * z
            weights, counts = load(total_weight, s * EIGHT), load(share, s * EIGHT)
            for c in range(THREE):
                at = red + c * EIGHT
                pull = pull_scale * (pull_red if c == 0 else (pull_green if c == 1 else pull_blue))
                shading = _shaded(basis, s, light[view, c])
                shading_ahead = _shaded(basis, s, light_ahead[view, c])
                before = load(albedo, at)
                misfit = (load(ahead, at) - before) * shading + before * shading_ahead - load(image, at)
                x = _moved(load(data_dual, at), misfit, data_gain, theta, one, two)
                store(data_dual, at, x)
                force = pull + shading * x - counts * clipped(spread(multiplier[view, c]), magnitude(shading))
                now = before - r * force / (weights + kappa * shading * shading)
                store(albedo, at, before + theta * (now - before))
                store(ahead_next, at, two * now - before)
                store(pulled, c * EIGHT, load(pulled, c * EIGHT) + before * pull)
                for k in range(size):
                    to = (c * size + k) * EIGHT
                    store(slope, to, load(slope, to) + x * before * load(basis, (s * size + k) * EIGHT))
        for c in range(THREE):
            pulls[block, c] = lane_sum(load(pulled, c * EIGHT))
            for k in range(size):
                slopes[block, c, k] = lane_sum(load(slope, (c * size + k) * EIGHT))


@numba.njit(inline="always")
def _moved(dual, difference, gain, theta, unit, twice):
    """A dual's step, relaxed; clipped once more to what 16 bits hold."""
    there = clipped(dual + gain * difference, unit)
    return clipped(dual + theta * (there - dual), twice)


@numba.njit(parallel=True, cache=True, nogil=True)
def inherit(first, neighbour, weight, dual, first_c, neighbour_c, weight_c, dual_c, group):
    """Look every edge between two groups up among the rows of its group."""
    for share in numba.prange(first.size - 1):
        s = np.int64(share)
        for at in range(np.int64(first[s]) * 8, np.int64(first[s + 1]) * 8):
            own, other = group[s * 8 + at % 8], group[_place(neighbour[at])]
            if weight[at] == 0 or own == other:
                continue
            wanted = (other // 8) * 24 + other % 8
            for row in range(np.int64(first_c[own // 8]), np.int64(first_c[own // 8 + 1])):
                at_c = row * 8 + own % 8
                if weight_c[at_c] > 0 and np.int64(neighbour_c[at_c]) == wanted:
                    for c in range(3):
                        dual[_held(at, c)] = dual_c[_held(at_c, c)]
                    break


@numba.njit(inline="always")
def _held(at, channel):
    """Where the dual of a half-edge lies."""
    return at // 8 * 24 + at % 8 + 8 * channel


@numba.njit(inline="always")
def _place(neighbour):
    """Place of a pixel from where its first channel lies."""
    return np.int64(neighbour) // 24 * 8 + np.int64(neighbour) % 24
