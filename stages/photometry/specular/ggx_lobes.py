"""Lobes of a rough mirror (GGX): what points would show of light from many directions, were they one."""

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
    """Average light (M, C) within the lobes of chosen points, were they a rough mirror, (n, C), float32.

    It is 0 where something hides the light. The ways `towards` the cameras, (N, 3), are unit vectors;
    roughness is α of GGX.
    """
    out = np.empty((len(points), radiance.shape[1]), np.float32)
    light = np.ascontiguousarray(radiance, np.float32)
    mirror = towards, np.float32(roughness), pixels.cells
    gather_mirrored(np.asarray(points), *pixels.geometry, *mirror, light, out)
    return out


def lobes(
    pixels: DirectionalTransport, towards: np.ndarray, roughness: float, points: np.ndarray
) -> np.ndarray:
    """Tell what each direction's light adds to that, per unit, (n, M), float32; see `mirrored_light`."""
    out = np.empty((len(points), len(pixels.directions)), np.float32)
    gather_lobes(np.asarray(points), *pixels.geometry, towards, np.float32(roughness), pixels.cells, out)
    return out
