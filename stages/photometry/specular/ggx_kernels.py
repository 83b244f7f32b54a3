"""Compiled loops over the lobes of a rough mirror (GGX) that gather light from all around at points."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.photometry.transport.irradiance_kernels import CHUNK, blended_visibility


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def gather_mirrored(
    points, normals, offsets, blend, visible, directions, towards, roughness, cells, radiance, out
):
    """Gather ``Σ_d V_d c_d m_d e_d / Σ_d c_d m_d`` at chosen points in three channels, (n, 3).

    m is that of `_mirroring`.
    """
    x, y, z = directions[:, 0].copy(), directions[:, 1].copy(), directions[:, 2].copy()  # to be vectorised
    for chunk in numba.prange((len(points) + CHUNK - 1) // CHUNK):
        seen, share = np.empty(8 * visible.shape[1], np.float32), np.empty(len(x))
        for k in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(points))):
            p = points[k]
            blended_visibility(p, blend, visible, seen)
            normal, offset, back = normals[p], offsets[p], towards[p]
            for d in range(len(x)):
                share[d] = cells[d] * _mirroring(normal, offset, x[d], y[d], z[d], back, roughness)
            red = green = blue = np.float32(0)
            total = np.float32(1e-12)
            for d in range(len(x)):
                total += share[d]
                red += seen[d] * share[d] * radiance[d, 0]
                green += seen[d] * share[d] * radiance[d, 1]
                blue += seen[d] * share[d] * radiance[d, 2]
            out[k, 0], out[k, 1], out[k, 2] = red / total, green / total, blue / total


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def gather_lobes(points, normals, offsets, blend, visible, directions, towards, roughness, cells, out):
    """Compute ``V_d c_d m_d / Σ_d c_d m_d`` at chosen points, (n, M), with m of `_mirroring`."""
    x, y, z = directions[:, 0].copy(), directions[:, 1].copy(), directions[:, 2].copy()  # to be vectorised
    for chunk in numba.prange((len(points) + CHUNK - 1) // CHUNK):
        seen, share = np.empty(8 * visible.shape[1], np.float32), np.empty(len(x))
        for k in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(points))):
            p = points[k]
            blended_visibility(p, blend, visible, seen)
            normal, offset, back = normals[p], offsets[p], towards[p]
            for d in range(len(x)):
                share[d] = cells[d] * _mirroring(normal, offset, x[d], y[d], z[d], back, roughness)
            total = np.float32(1e-12)
            for d in range(len(x)):
                total += share[d]
            for d in range(len(x)):
                out[k, d] = seen[d] * share[d] / total


@numba.njit(inline="always", error_model="numpy")
def _mirroring(normal, offset, dx, dy, dz, towards, roughness):
    """Evaluate the specular lobe for one source, up to factors common to all directions.

    The source is as in `irradiance_kernels._arriving`.

    Microfacets by Trowbridge and Reitz (GGX), with Smith's shadowing of the light alone (Walter et al. 2007,
    Eq. 20, 33, 34); without the Fresnel factor.
    """
    x, y, z = dx - offset[0], dy - offset[1], dz - offset[2]
    squared = x * x + y * y + z * z
    distance = np.sqrt(squared)
    cosine = (x * normal[0] + y * normal[1] + z * normal[2]) / distance
    sent = (x * dx + y * dy + z * dz) / distance
    x, y, z = x / distance + towards[0], y / distance + towards[1], z / distance + towards[2]
    half = (x * normal[0] + y * normal[1] + z * normal[2]) / np.sqrt(x * x + y * y + z * z + 1e-12)
    squared_alpha = roughness * roughness
    facets = 1 / (half * half * (squared_alpha - 1) + 1) ** 2
    unshadowed = 2 * cosine / (cosine + np.sqrt(squared_alpha + (1 - squared_alpha) * cosine * cosine))
    mirrored = facets * unshadowed * sent / squared
    return mirrored if (cosine > 0) & (sent > 0) else np.float32(0)  # no branch
