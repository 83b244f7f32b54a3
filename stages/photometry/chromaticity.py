"""Chromaticity: the colour of a material, invariant to the amount of light."""

from __future__ import annotations

import numpy as np

DARK = 0.02  # of the scaled image: below, chromaticity is noise
NEAR_BLACK = 1e-6
NO_SHADING = 1e-3


def chroma_of(image: np.ndarray) -> np.ndarray:
    """Compute the logarithms of red and blue over green, (N, 2), near 0 in dark pixels."""
    logs = np.log(np.maximum(image, 0) + DARK)
    return logs[:, [0, 2]] - logs[:, [1]]


def colour_change(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Compute the squared change of chromaticity between pixels and their neighbours, (n, 3); (n,).

    Notes
    -----
    ``|Δ (log(r + d) − log(g + d), log(b + d) − log(g + d))|²`` with d = 0.02 of the scaled image against
    noise. The brighter pixel is first scaled down to the brightness of the darker. This makes the change
    between equal albedos 0 in any amount of light, even where a channel reflects almost nothing.
    """
    levels = [np.maximum(pixels.mean(axis=1, keepdims=True), NEAR_BLACK) for pixels in (one, other)]
    least = np.minimum(*levels)
    change = chroma_of(one * (least / levels[0])) - chroma_of(other * (least / levels[1]))
    return (change**2).sum(axis=1)


def in_white_light(image: np.ndarray, shading: np.ndarray) -> np.ndarray:
    """Remove the light's colour from an image, (N, 3), and keep its brightness: I · mean(S) / S, float32.

    S is limited to at least a tenth of its mean; without any light the result is nearly black.

    Local changes of the light's colour (interreflection of red surface, blue skylight in shadows) are then
    not mistaken for albedo.
    """
    mean = shading.mean(axis=1, keepdims=True)
    return (image * (mean / np.maximum(shading, np.maximum(0.1 * mean, NO_SHADING)))).astype(np.float32)
