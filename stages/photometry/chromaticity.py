"""Colour apart from brightness: of paint, in any amount of light."""

from __future__ import annotations

import numpy as np

DARK = 0.02  # of the scaled image: below, chromaticity is noise
NEAR_BLACK = 1e-6
NO_SHADING = 1e-3


def chroma_of(image: np.ndarray) -> np.ndarray:
    """Take the logarithms of red and blue over green, (N, 2); of what is dark, next to nothing."""
    logs = np.log(np.maximum(image, 0) + DARK)
    return logs[:, [0, 2]] - logs[:, [1]]


def colour_change(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Compute the square of the change of chromaticity between pixels (n, 3) and their neighbours, (n,).

    Notes
    -----
    ``|Δ (log(r + d) − log(g + d), log(b + d) − log(g + d))|²`` with d = 0.02 of the scaled image
    for the sake of noise, the brighter pixel first scaled down to the brightness of the darker. So one
    paint has one colour in any amount of light, even where it sends back next to nothing in some channel.
    """
    levels = [np.maximum(pixels.mean(axis=1, keepdims=True), NEAR_BLACK) for pixels in (one, other)]
    least = np.minimum(*levels)
    change = chroma_of(one * (least / levels[0])) - chroma_of(other * (least / levels[1]))
    return (change**2).sum(axis=1)


def in_white_light(image: np.ndarray, shading: np.ndarray) -> np.ndarray:
    """Take the light's colour out of an image, (N, 3), and leave its brightness in: I · mean(S) / S, float32.

    S counts as no less than a tenth of its mean; where there is no light at all the result is next to black.

    What light does to colours from place to place (red that a mouth throws on itself, blue of the sky in the
    shadows) is then not taken for paint.
    """
    mean = shading.mean(axis=1, keepdims=True)
    return (image * (mean / np.maximum(shading, np.maximum(0.1 * mean, NO_SHADING)))).astype(np.float32)
