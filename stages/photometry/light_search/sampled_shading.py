"""Direct shading of sampled pixels under lights from all around, and its transpose: compiled loops."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401
from stages.solvers.kernels.equal_parts import part_of
from stages.solvers.kernels.simd import COUNT, lane_sum, load, spread, store

PARTS = 16  # of the pixels


class SampledShading:
    """Shading of a sample's pixels, linear in the lights.

    Parameters
    ----------
    shares : ndarray, shape (n, M), float32
        Shading of a pixel per unit of radiance from each direction.
    light_of : ndarray, shape (n,)
        Index, of G, of the light of a pixel.
    """

    def __init__(self, shares: np.ndarray, light_of: np.ndarray) -> None:
        self._directions = shares.shape[1]
        self._shares, self._light_of = _padded(shares), light_of.astype(np.int32)

    def beside(self, bounced: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Compute the shading, (n, 3), under lights, (G, M, 3), beside interreflection, (n, 3)."""
        shading = bounced.astype(np.float64)
        add_shading(self._shares, self._light_of, _padded(light.transpose(0, 2, 1)), shading)
        return shading

    def slope_by_light(self, by_shading: np.ndarray, lights: int) -> np.ndarray:
        """Convert a slope by the shading, (n, 3), to that by G lights, (G, M, 3), float64."""
        sums = np.zeros((PARTS, lights, 3, self._shares.shape[1]), np.float32)
        add_slopes(self._shares, self._light_of, by_shading.astype(np.float32), sums)
        return sums.sum(axis=0, dtype=np.float64)[..., : self._directions].transpose(0, 2, 1)


def _padded(values: np.ndarray) -> np.ndarray:
    """Append zeros to rows, (…, M), so that lanes divide them."""
    width = -(-values.shape[-1] // COUNT) * COUNT
    wide = np.zeros((*values.shape[:-1], width), np.float32)
    wide[..., : values.shape[-1]] = values
    return wide


@numba.njit(parallel=True, cache=True, nogil=True)
def add_shading(shares, light_of, lights, shading):
    """Add ``Σ_d share_d e_d`` to the shading of every pixel, in three channels."""
    for part in numba.prange(PARTS):
        for p in range(*part_of(part, PARTS, len(shares))):
            row, light = shares[p], lights[light_of[p]]
            red = green = blue = spread(np.float32(0))
            for d in range(0, len(row), COUNT):
                share = load(row, d)
                red = red + share * load(light[0], d)
                green = green + share * load(light[1], d)
                blue = blue + share * load(light[2], d)
            shading[p, 0] += lane_sum(red)
            shading[p, 1] += lane_sum(green)
            shading[p, 2] += lane_sum(blue)


@numba.njit(parallel=True, cache=True, nogil=True)
def add_slopes(shares, light_of, by_shading, sums):
    """Add ``Σ_p share_pd slope_p`` of each of P parts of the pixels to its sums, (P, G, 3, M padded)."""
    for part in numba.prange(PARTS):
        for p in range(*part_of(part, PARTS, len(shares))):
            row, slope = shares[p], sums[part, light_of[p]]
            of_red, of_green, of_blue = by_shading[p]
            red, green, blue = spread(of_red), spread(of_green), spread(of_blue)
            for d in range(0, len(row), COUNT):
                share = load(row, d)
                store(slope[0], d, load(slope[0], d) + share * red)
                store(slope[1], d, load(slope[1], d) + share * green)
                store(slope[2], d, load(slope[2], d) + share * blue)
