"""The compiled loops of light from all around: what reaches a point, and what pairs of points disagree by."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401

CHUNK = 1024  # points that share a buffer


@numba.njit(parallel=True, cache=True, nogil=True)
def gather_irradiance(normals, offsets, blend, visible, directions, radiance, out):
    """``Σ_d V_d g_d e_d`` of every point and channel, (N, C), with g of `_arriving`."""
    for chunk in numba.prange((len(normals) + CHUNK - 1) // CHUNK):
        seen = np.empty(8 * visible.shape[1], np.float32)
        for p in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(normals))):
            _look(p, blend, visible, seen)
            out[p] = 0
            for d in range(len(directions)):
                share = seen[d] * _arriving(normals[p], offsets[p], directions[d])
                if share > 0:
                    for c in range(out.shape[1]):
                        out[p, c] += share * radiance[d, c]


@numba.njit(parallel=True, cache=True, nogil=True)
def gather_shares(points, normals, offsets, blend, visible, directions, out):
    """``V_d g_d`` of chosen points and all directions, (n, M)."""
    for chunk in numba.prange((len(points) + CHUNK - 1) // CHUNK):
        seen = np.empty(8 * visible.shape[1], np.float32)
        for k in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(points))):
            _look(points[k], blend, visible, seen)
            for d in range(len(directions)):
                p = points[k]
                out[k, d] = seen[d] * _arriving(normals[p], offsets[p], directions[d])


@numba.njit(parallel=True, cache=True, nogil=True)
def gather_mirrored(
    points, normals, offsets, blend, visible, directions, towards, roughness, cells, radiance, out
):
    """``Σ_d V_d c_d m_d e_d / Σ_d c_d m_d`` of chosen points and channels, (n, C), with m of `_mirroring`."""
    for chunk in numba.prange((len(points) + CHUNK - 1) // CHUNK):
        seen = np.empty(8 * visible.shape[1], np.float32)
        for k in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(points))):
            p = points[k]
            _look(p, blend, visible, seen)
            out[k] = 0
            total = np.float32(1e-12)
            for d in range(len(directions)):
                share = cells[d] * _mirroring(normals[p], offsets[p], directions[d], towards[p], roughness)
                if share > 0:
                    total += share
                    for c in range(out.shape[1]):
                        out[k, c] += seen[d] * share * radiance[d, c]
            out[k] /= total


@numba.njit(parallel=True, cache=True, nogil=True)
def gather_lobes(points, normals, offsets, blend, visible, directions, towards, roughness, cells, out):
    """``V_d c_d m_d / Σ_d c_d m_d`` of chosen points and all directions, (n, M), with m of `_mirroring`."""
    for chunk in numba.prange((len(points) + CHUNK - 1) // CHUNK):
        seen = np.empty(8 * visible.shape[1], np.float32)
        for k in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(points))):
            p = points[k]
            _look(p, blend, visible, seen)
            total = np.float32(1e-12)
            for d in range(len(directions)):
                share = cells[d] * _mirroring(normals[p], offsets[p], directions[d], towards[p], roughness)
                total += share
                out[k, d] = seen[d] * share
            for d in range(len(directions)):
                out[k, d] /= total


@numba.njit(cache=True, nogil=True)
def pair_losses(values, trust, first, second, weight, scale, colour, slope):
    """Sum of ``weight · u/(1 + u)`` with ``u = (m² + colour² v) / scale²``; adds its slope by the values.

    m is the mean of the channels' differences, v their variance, each channel as far as it is trusted.
    """
    total = 0.0
    for k in range(first.size):
        a, b = first[k], second[k]
        shared, mean, squared = 1e-9, 0.0, 0.0
        for c in range(values.shape[1]):
            both = trust[a, c] * trust[b, c]
            shared += both
            mean += both * (values[a, c] - values[b, c])
        mean /= shared
        for c in range(values.shape[1]):
            off = colour * (values[a, c] - values[b, c] - mean)
            squared += trust[a, c] * trust[b, c] * (mean * mean + off * off)
        u = squared / (shared * scale * scale)
        total += weight[k] * u / (1 + u)
        pull = 2 * weight[k] / ((1 + u) * (1 + u) * scale * scale * shared)
        for c in range(values.shape[1]):
            off = values[a, c] - values[b, c] - mean
            force = pull * trust[a, c] * trust[b, c] * (mean + colour * colour * off)
            slope[a, c] += force
            slope[b, c] -= force
    return total


@numba.njit(nogil=True)
def _look(point, blend, visible, seen):
    """V of all directions at a blend of vertices; a blend of none sees everything."""
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
    """Light on a point from a small source at ``direction``, that faces the origin, on a sphere of radius 1.

    The point is at ``offset``; where that is 0 the sphere is infinitely large.
    """
    x, y, z = direction[0] - offset[0], direction[1] - offset[1], direction[2] - offset[2]
    squared = x * x + y * y + z * z
    received = x * normal[0] + y * normal[1] + z * normal[2]
    sent = x * direction[0] + y * direction[1] + z * direction[2]
    if received <= 0 or sent <= 0:
        return np.float32(0)
    return received * sent / (squared * squared)


@numba.njit(inline="always", error_model="numpy")
def _mirroring(normal, offset, direction, towards, roughness):
    """What a rough mirror sends on from a source as in `_arriving`, but for factors all directions share.

    Facets by Trowbridge and Reitz (GGX), shadowed on the light's side by Smith's G (Walter et al. 2007, Eq.
    20, 33, 34); without Fresnel's factor.
    """
    x, y, z = direction[0] - offset[0], direction[1] - offset[1], direction[2] - offset[2]
    squared = x * x + y * y + z * z
    distance = np.sqrt(squared)
    cosine = (x * normal[0] + y * normal[1] + z * normal[2]) / distance
    sent = (x * direction[0] + y * direction[1] + z * direction[2]) / distance
    if cosine <= 0 or sent <= 0:
        return np.float32(0)
    x, y, z = x / distance + towards[0], y / distance + towards[1], z / distance + towards[2]
    half = (x * normal[0] + y * normal[1] + z * normal[2]) / np.sqrt(x * x + y * y + z * z + 1e-12)
    squared_alpha = roughness * roughness
    facets = 1 / (half * half * (squared_alpha - 1) + 1) ** 2
    unshadowed = 2 * cosine / (cosine + np.sqrt(squared_alpha + (1 - squared_alpha) * cosine * cosine))
    return facets * unshadowed * sent / squared
