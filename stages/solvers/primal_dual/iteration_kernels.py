"""Compiled kernels of `PrimalDual`: an iteration, the shading, the gauge."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.solvers.kernels.interleaved_pixels import (
    gather_channels,
    load_channels,
    prefetch_pixels,
    store_channels,
)
from stages.solvers.kernels.simd import (
    clipped,
    lane_sum,
    load,
    magnitude,
    spread,
    store,
)
from stages.solvers.kernels.sliced_ellpack import EIGHT, ONE, QUADS, SIXTEEN, SLICE, THREE, ZERO
from stages.solvers.primal_dual.anchor import DATA_NOTCH, EDGE_NOTCH
from stages.solvers.primal_dual.duality_gap import UNIT

CHUNK = np.uint64(32)  # slices whose pulls stay in the nearest cache
FORESIGHT = np.uint64(64)  # rows of half-edges to prefetch: neighbours in other views are far in memory
WHOLE = np.float32(1)  # weight of the iterate without an anchor
TWICE = np.float32(2) * UNIT  # range of 16 bits


@numba.njit(parallel=True, cache=True, nogil=True)
def shade(views, begins, ends, basis, light, shading):
    """Compute ``S = σ·ν`` of every slice and channel."""
    size = np.uint64(light.shape[2])
    stride, step = strides(basis, np.uint64(shading.size), size)
    for block in numba.prange(views.size):
        for s in range(np.uint64(begins[block]), np.uint64(ends[block])):
            for c in range(THREE):
                total = spread(np.float32(0))
                for k in range(size):
                    value = load(basis, (s * size + k) * stride + c * step)
                    total = total + spread(light[views[block], c, k]) * value
                store(shading, (s * THREE + c) * EIGHT, total)


@numba.njit(parallel=True, cache=True, nogil=True)
def weigh(begins, ends, albedo, share, sums):
    """Compute ``Σ share |ρ|`` of every block and channel."""
    for block in numba.prange(begins.size):
        for c in range(THREE):
            total = spread(np.float32(0))
            for s in range(np.uint64(begins[block]), np.uint64(ends[block])):
                total = total + load(share, s * EIGHT) * magnitude(load(albedo, s * SLICE + c * EIGHT))
            sums[block, c] = lane_sum(total)


@numba.njit(parallel=True, cache=True, nogil=True)
def rescale(views, begins, ends, factors, albedo, ahead):
    """Multiply every view's albedo, and the interleaved extrapolated one, by its factors (n, 3)."""
    for block in numba.prange(begins.size):
        own = factors[views[block]]
        for s in range(np.uint64(begins[block]), np.uint64(ends[block])):
            for c in range(THREE):
                at = s * SLICE + c * EIGHT
                store(albedo, at, spread(own[c]) * load(albedo, at))
            red, green, blue = load_channels(ahead, s * QUADS)
            red, green, blue = spread(own[0]) * red, spread(own[1]) * green, spread(own[2]) * blue
            store_channels(ahead, s * QUADS, red, green, blue)


@numba.njit(parallel=True, cache=True, nogil=True)
def interleave(sliced, interleaved):
    """Interleave three channels of eight pixels, (S, 3, 8), to four numbers per pixel, (S · 8, 4)."""
    for share in numba.prange(sliced.size // SLICE):
        s = np.uint64(share)
        red, green, blue = _channels(sliced, s * SLICE)
        store_channels(interleaved, s * QUADS, red, green, blue)


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def sweep(blocks, graph, duals, albedos, anchors, givens, lights, multiplier, steps, slopes, pulls):
    """Perform one iteration, in place except for the extrapolated albedo, which neighbours still read.

    `lights` is (n, K, 6): per harmonic the light of three channels, then the extrapolated light. `steps` are
    r, κ, θ and the weight of the iterate beside the `anchors`: duals of edges and data, quantised; albedo.
    """
    views, begins, ends = blocks
    first, neighbour, weight, total_weight = graph
    edge_dual, data_dual = duals
    albedo, ahead, ahead_next = albedos
    image, basis, share = givens
    size = np.uint64(lights.shape[1])
    layout = strides(basis, np.uint64(albedo.size), size)
    for block in numba.prange(views.size):
        view, end = views[block], np.uint64(ends[block])
        slope, pulled = np.zeros(SLICE * size, np.float32), np.zeros(SLICE, np.float32)
        pull, shading = (
            np.empty(CHUNK * SLICE, np.float32),
            np.empty(CHUNK * SLICE * np.uint64(2), np.float32),
        )
        for begin in range(np.uint64(begins[block]), end, CHUNK):
            stop = min(begin + CHUNK, end)
            _move_edge_duals(
                begin, stop, (first, neighbour, weight), (edge_dual, anchors[0]), ahead, steps, pull
            )
            _shade_both(begin, stop, basis, layout, lights[view], shading)
            _move_pixels(
                begin,
                stop,
                (albedo, ahead, ahead_next),
                anchors,
                (data_dual, image, total_weight, share),
                (pull, shading),
                multiplier[view],
                steps,
                pulled,
            )
            _add_slopes(begin, stop, basis, layout, pull, slope)
        for c in range(THREE):
            pulls[block, c] = lane_sum(load(pulled, c * EIGHT))
            for k in range(size):
                slopes[block, c, k] = lane_sum(load(slope, k * SLICE + c * EIGHT))


@numba.njit(nogil=True)
def _move_edge_duals(begin, stop, graph, duals, ahead, steps, pull):
    """Update all edge duals of a chunk; writes ``Kᵀy`` of its pixels to `pull`."""
    (first, neighbour, weight), (edge_dual, anchor) = graph, duals
    gain, theta, part = spread(np.float32(0.5) * UNIT / steps[0]), spread(steps[2]), steps[3]
    notch = spread(EDGE_NOTCH)
    last = first[first.size - ONE] - ONE
    unit, twice, whole = spread(UNIT), spread(TWICE), spread(np.float32(1) / UNIT)
    for s in range(begin, stop):
        own_red, own_green, own_blue = load_channels(ahead, s * QUADS)
        pull_red, pull_green, pull_blue = spread(np.float32(0)), spread(np.float32(0)), spread(np.float32(0))
        for row in range(first[s], first[s + ONE]):
            prefetch_pixels(ahead, neighbour, min(row + FORESIGHT, last) * EIGHT)
            held, w = row * SLICE, load(weight, row * EIGHT)
            red, green, blue = gather_channels(ahead, neighbour, row * EIGHT)
            z_red, z_green, z_blue = _channels(edge_dual, held)
            z_red = _moved(z_red, own_red - red, gain, theta, unit, twice)
            z_green = _moved(z_green, own_green - green, gain, theta, unit, twice)
            z_blue = _moved(z_blue, own_blue - blue, gain, theta, unit, twice)
            if part < WHOLE:
                red, green, blue = _channels(anchor, held)
                z_red = _averaged(z_red, notch * red, part)
                z_green = _averaged(z_green, notch * green, part)
                z_blue = _averaged(z_blue, notch * blue, part)
            _store_channels(edge_dual, held, z_red, z_green, z_blue)
            pull_red, pull_green, pull_blue = (
                pull_red + w * z_red,
                pull_green + w * z_green,
                pull_blue + w * z_blue,
            )
        _store_channels(pull, (s - begin) * SLICE, whole * pull_red, whole * pull_green, whole * pull_blue)


@numba.njit(nogil=True)
def _shade_both(begin, stop, basis, layout, light, shading):
    """Compute ``S`` and ``S̄`` of a chunk, three channels each."""
    size, (stride, step) = np.uint64(light.shape[0]), layout
    for s in range(begin, stop):
        red, green, blue = spread(np.float32(0)), spread(np.float32(0)), spread(np.float32(0))
        red_ahead, green_ahead, blue_ahead = red, green, blue
        for k in range(size):
            r, g, b = _three(basis, (s * size + k) * stride, step)
            red, red_ahead = red + spread(light[k, 0]) * r, red_ahead + spread(light[k, 3]) * r
            green, green_ahead = green + spread(light[k, 1]) * g, green_ahead + spread(light[k, 4]) * g
            blue, blue_ahead = blue + spread(light[k, 2]) * b, blue_ahead + spread(light[k, 5]) * b
        to = (s - begin) * SLICE * np.uint64(2)
        _store_channels(shading, to, red, green, blue)
        _store_channels(shading, to + SLICE, red_ahead, green_ahead, blue_ahead)


@numba.njit(nogil=True, error_model="numpy")
def _move_pixels(begin, stop, albedos, anchors, givens, made, multiplier, steps, pulled):
    """Update data duals and albedos of a chunk; `pull` then holds ``x ρ``, for the light's gradient."""
    albedo, ahead, ahead_next = albedos
    data_dual, image, total_weight, share = givens
    pull, shadings = made
    scale, data_step_ratio, relaxation, part = steps
    gain, kappa = spread(np.float32(0.5) * data_step_ratio / scale), spread(data_step_ratio)
    r, theta = spread(scale), spread(relaxation)
    one, two = spread(np.float32(1)), spread(np.float32(2))
    for s in range(begin, stop):
        weights, counts = load(total_weight, s * EIGHT), load(share, s * EIGHT)
        here = load_channels(ahead, s * QUADS)
        for c in range(THREE):
            at, local = s * SLICE + c * EIGHT, (s - begin) * SLICE + c * EIGHT
            own_ahead = here[0] if c == ZERO else (here[1] if c == ONE else here[2])
            before, force = load(albedo, at), load(pull, local)
            shading = load(shadings, local + (s - begin) * SLICE)
            shading_ahead = load(shadings, local + (s - begin + ONE) * SLICE)
            misfit = (own_ahead - before) * shading + before * shading_ahead - load(image, at)
            x = _moved(load(data_dual, at), misfit, gain, theta, one, two)
            if part < WHOLE:
                x = _averaged(x, spread(DATA_NOTCH) * load(anchors[1], at), part)
            store(data_dual, at, x)
            store(pulled, c * EIGHT, load(pulled, c * EIGHT) + before * force)
            held = counts * clipped(spread(multiplier[c]), magnitude(shading))
            now = before - r * (force + shading * x - held) / (weights + kappa * shading * shading)
            moved = before + theta * (now - before)
            if part < WHOLE:
                moved = _averaged(moved, load(anchors[2], at), part)
            store(albedo, at, moved)
            store(pull, local, x * before)
            store(shadings, local + (s - begin) * SLICE, two * now - before)
        red, green, blue = _channels(shadings, (s - begin) * SLICE * np.uint64(2))
        store_channels(ahead_next, s * QUADS, red, green, blue)


@numba.njit(nogil=True)
def _add_slopes(begin, stop, basis, layout, force, slope):
    """Add ``Σ_p x ρ ν`` of a chunk, harmonic by harmonic."""
    size, (stride, step) = np.uint64(slope.size) // SLICE, layout
    for k in range(size):
        red, green, blue = _channels(slope, k * SLICE)
        for s in range(begin, stop):
            nu_red, nu_green, nu_blue = _three(basis, (s * size + k) * stride, step)
            pull_red, pull_green, pull_blue = _channels(force, (s - begin) * SLICE)
            red, green, blue = (
                red + nu_red * pull_red,
                green + nu_green * pull_green,
                blue + nu_blue * pull_blue,
            )
        _store_channels(slope, k * SLICE, red, green, blue)


@numba.njit(inline="always")
def strides(basis, values, size):
    """Compute the strides between harmonics and between channels; 0 where the channels share ν.

    `values` is the size of three channels of all slices, `size` the number of harmonics.
    """
    shared = basis.size < values * size
    return (EIGHT, ZERO) if shared else (SLICE, EIGHT)


@numba.njit(inline="always")
def _channels(array, at):
    """Load three channels of a slice."""
    return _three(array, at, EIGHT)


@numba.njit(inline="always")
def _three(array, at, step):
    return load(array, at), load(array, at + step), load(array, at + step + step)


@numba.njit(inline="always")
def _store_channels(array, at, red, green, blue):
    store(array, at, red)
    store(array, at + EIGHT, green)
    store(array, at + SIXTEEN, blue)


@numba.njit(inline="always")
def _moved(dual, difference, gain, theta, unit, twice):
    """Update a dual, relaxed; clipped again to the range of 16 bits."""
    there = clipped(dual + gain * difference, unit)
    return clipped(dual + theta * (there - dual), twice)


@numba.njit(inline="always")
def _averaged(value, anchor, part):
    """Average value and anchor with weights `part` and 1 − `part`."""
    return spread(part) * value + spread(np.float32(1) - part) * anchor
