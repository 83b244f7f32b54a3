"""Compiled loops over the lobes of a rough mirror (GGX) that gather light from all around at points."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.photometry.transport.irradiance_kernels import CHUNK, blended_visibility


@numba.njit(parallel=True, cache=True, nogil=True)
def gather_mirrored(
    points, normals, offsets, blend, visible, directions, towards, roughness, cells, radiance, out
):
    """Gather ``Σ_d V_d c_d m_d e_d / Σ_d c_d m_d`` at chosen points, (n, C), with m of `_mirroring`."""
    for chunk in numba.prange((len(points) + CHUNK - 1) // CHUNK):
        seen = np.empty(8 * visible.shape[1], np.float32)
        for k in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(points))):
            p = points[k]
            blended_visibility(p, blend, visible, seen)
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
    """Compute ``V_d c_d m_d / Σ_d c_d m_d`` at chosen points, (n, M), with m of `_mirroring`."""
    for chunk in numba.prange((len(points) + CHUNK - 1) // CHUNK):
        seen = np.empty(8 * visible.shape[1], np.float32)
        for k in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(points))):
            p = points[k]
            blended_visibility(p, blend, visible, seen)
            total = np.float32(1e-12)
            for d in range(len(directions)):
                share = cells[d] * _mirroring(normals[p], offsets[p], directions[d], towards[p], roughness)
                total += share
                out[k, d] = seen[d] * share
            for d in range(len(directions)):
                out[k, d] /= total


@numba.njit(inline="always", error_model="numpy")
def _mirroring(normal, offset, direction, towards, roughness):
    """Evaluate the specular lobe for one source, up to factors common to all directions.

    The source is as in `irradiance_kernels._arriving`.

    Microfacets by Trowbridge and Reitz (GGX), with Smith's shadowing of the light alone (Walter et al. 2007,
    Eq. 20, 33, 34); without the Fresnel factor.
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
