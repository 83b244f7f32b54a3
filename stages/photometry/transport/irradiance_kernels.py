"""Compiled loops that gather light from all around at points: visibility, then irradiance."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401

CHUNK = 1024  # points that share a buffer


@numba.njit(parallel=True, cache=True, nogil=True)
def gather_irradiance(normals, offsets, blend, visible, directions, radiance, out):
    """Gather ``Σ_d V_d g_d e_d`` at every point and channel, (N, C), with g of `_arriving`."""
    for chunk in numba.prange((len(normals) + CHUNK - 1) // CHUNK):
        seen = np.empty(8 * visible.shape[1], np.float32)
        for p in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(normals))):
            blended_visibility(p, blend, visible, seen)
            out[p] = 0
            for d in range(len(directions)):
                share = seen[d] * _arriving(normals[p], offsets[p], directions[d])
                if share > 0:
                    for c in range(out.shape[1]):
                        out[p, c] += share * radiance[d, c]


@numba.njit(parallel=True, cache=True, nogil=True)
def gather_shares(points, normals, offsets, blend, visible, directions, out):
    """Compute ``V_d g_d`` of chosen points and all directions, (n, M), with g of `_arriving`."""
    for chunk in numba.prange((len(points) + CHUNK - 1) // CHUNK):
        seen = np.empty(8 * visible.shape[1], np.float32)
        for k in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(points))):
            blended_visibility(points[k], blend, visible, seen)
            for d in range(len(directions)):
                p = points[k]
                out[k, d] = seen[d] * _arriving(normals[p], offsets[p], directions[d])


@numba.njit(nogil=True)
def blended_visibility(point, blend, visible, seen):
    """Interpolate V of all directions from a blend of vertices; an empty blend sees everything."""
    first, vertex, weight = blend
    begin, end = first[point], first[point + 1]
    if begin == end:
        seen[:] = 1
        return
    seen[:] = 0
    for k in range(begin, end):
        for byte in range(visible.shape[1]):
            bits = visible[vertex[k], byte]
            if bits == 0:
                continue
            for bit in range(8):
                if bits & (128 >> bit):
                    seen[8 * byte + bit] += weight[k]


@numba.njit(inline="always", error_model="numpy")
def _arriving(normal, offset, direction):
    """Compute irradiance from a small source at ``direction`` on the unit sphere, facing its centre.

    The point is at ``offset``; an offset of 0 stands for a source at infinity.
    """
    x, y, z = direction[0] - offset[0], direction[1] - offset[1], direction[2] - offset[2]
    squared = x * x + y * y + z * z
    received = x * normal[0] + y * normal[1] + z * normal[2]
    sent = x * direction[0] + y * direction[1] + z * direction[2]
    if received <= 0 or sent <= 0:
        return np.float32(0)
    return received * sent / (squared * squared)
