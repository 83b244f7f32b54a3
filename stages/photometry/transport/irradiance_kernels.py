"""Compiled loops that gather light from all around at points: visibility, then irradiance."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.solvers.kernels.simd import COUNT, lane_sum, load, spread, store

CHUNK = 1024  # points that share a buffer
BITS = np.unpackbits(np.arange(256, dtype=np.uint8)).astype(np.float32)  # of each byte, highest first


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def gather_irradiance(normals, offsets, blend, visible, traced, directions, radiance, out):
    """Gather ``Σ_d V_d g_d e_d`` at every point in three channels, (N, 3), with g of `_arriving`."""
    x, y, z = directions[:, 0].copy(), directions[:, 1].copy(), directions[:, 2].copy()  # to be vectorised
    lanes = 8 * visible.shape[1]
    light = np.zeros((3, lanes), np.float32)
    light[:, : len(radiance)] = radiance.T
    of_red, of_green, of_blue = light[0], light[1], light[2]
    for chunk in numba.prange((len(normals) + CHUNK - 1) // CHUNK):
        seen = np.empty(lanes, np.float32)
        for p in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(normals))):
            blended_visibility(p, blend, visible, seen)
            _seen_from_itself(traced[p], len(directions), seen)
            normal, offset = normals[p], offsets[p]
            for d in range(len(directions)):
                seen[d] *= _arriving(normal, offset, x[d], y[d], z[d])
            red = green = blue = spread(np.float32(0))
            for d in range(0, lanes, COUNT):
                arriving = load(seen, d)
                red = red + arriving * load(of_red, d)
                green = green + arriving * load(of_green, d)
                blue = blue + arriving * load(of_blue, d)
            out[p, 0], out[p, 1], out[p, 2] = lane_sum(red), lane_sum(green), lane_sum(blue)


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def gather_shares(points, normals, offsets, blend, visible, traced, directions, out):
    """Compute ``V_d g_d`` of chosen points and all directions, (n, M), with g of `_arriving`."""
    x, y, z = directions[:, 0].copy(), directions[:, 1].copy(), directions[:, 2].copy()  # to be vectorised
    for chunk in numba.prange((len(points) + CHUNK - 1) // CHUNK):
        seen = np.empty(8 * visible.shape[1], np.float32)
        for k in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(points))):
            p = points[k]
            blended_visibility(p, blend, visible, seen)
            _seen_from_itself(traced[p], len(directions), seen)
            normal, offset = normals[p], offsets[p]
            for d in range(len(directions)):
                out[k, d] = seen[d] * _arriving(normal, offset, x[d], y[d], z[d])


@numba.njit(nogil=True)
def blended_visibility(point, blend, visible, seen):
    """Interpolate V of all directions from a blend of vertices; an empty blend sees everything."""
    first, vertex, weight = blend
    begin, end = first[point], first[point + 1]
    if begin == end:
        seen[:] = 1
        return
    for byte in range(visible.shape[1]):
        total = spread(np.float32(0))
        for k in range(begin, end):
            bits = np.int64(visible[vertex[k], byte])
            total = total + spread(weight[k]) * load(BITS, 8 * bits)
        store(seen, 8 * byte, total)


@numba.njit(nogil=True)
def _seen_from_itself(traced, directions, seen):
    """Replace V of the last directions by that found from the point itself, in 255ths."""
    for k in range(len(traced)):
        seen[directions - len(traced) + k] = np.float32(traced[k]) / np.float32(255)


@numba.njit(inline="always", error_model="numpy")
def _arriving(normal, offset, dx, dy, dz):
    """Compute irradiance from a small source in a direction on the unit sphere, facing its centre.

    The point is at ``offset``; an offset of 0 stands for a source at infinity.
    """
    x, y, z = dx - offset[0], dy - offset[1], dz - offset[2]
    squared = x * x + y * y + z * z
    received = x * normal[0] + y * normal[1] + z * normal[2]
    sent = x * dx + y * dy + z * dz
    arriving = received * sent / (squared * squared)
    return arriving if (received > 0) & (sent > 0) else np.float32(0)  # no branch
