"""Specular lobes (GGX) of points under light from many directions."""

from __future__ import annotations

import numpy as np

from stages.photometry.specular.ggx_kernels import gather_lobes, gather_mirrored
from stages.photometry.transport.directional_transport import DirectionalTransport


def mirrored_light(
    pixels: DirectionalTransport,
    radiance: np.ndarray,
    towards: np.ndarray,
    roughness: float,
    points: np.ndarray,
) -> np.ndarray:
    """Average light (M, 3) within the specular lobes of chosen points, (n, 3), float32.

    Occluded light counts as 0. `towards`, (N, 3), are unit vectors to the cameras; roughness is α of GGX.
    """
    out = np.empty((len(points), 3), np.float32)
    light = np.ascontiguousarray(radiance, np.float32)
    mirror = towards, np.float32(roughness), pixels.cells
    gather_mirrored(np.asarray(points), *pixels.geometry, *mirror, light, out)
    return out


def lobes(
    pixels: DirectionalTransport, towards: np.ndarray, roughness: float, points: np.ndarray
) -> np.ndarray:
    """Compute the weight of each direction in `mirrored_light` of chosen points, (n, M), float32."""
    out = np.empty((len(points), len(pixels.directions)), np.float32)
    gather_lobes(np.asarray(points), *pixels.geometry, towards, np.float32(roughness), pixels.cells, out)
    return out
