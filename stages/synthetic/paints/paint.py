"""Albedo at surface points: one colour per part (the paper's Table 1), stripes, or a paint for matching."""

from __future__ import annotations

import numpy as np

from stages.synthetic.paints.solid_noise import nearest_cell, octaves, smooth_noise

# True albedos of the paper's Table 1 (red, green, blue), in the order of bust.PARTS.
TABLE_1 = np.array(
    [(1.0, 0.0314, 0.0), (1.0, 0.5333, 0.3608), (0.0196, 0.0549, 1.0), (0.1216, 0.1216, 0.1216)]
)

STRIPE = np.array([0.80, 0.72, 0.30])

# Three pigments per part, linear: ground, patches, speckles. All within [0.03, 0.85]: no channel so dark that
# a ratio means nothing, none so bright that no real paint has it.
PIGMENTS = np.array(
    [
        [(0.42, 0.20, 0.08), (0.13, 0.06, 0.035), (0.75, 0.52, 0.26)],
        [(0.68, 0.45, 0.33), (0.44, 0.22, 0.16), (0.82, 0.68, 0.52)],
        [(0.10, 0.22, 0.46), (0.07, 0.36, 0.34), (0.72, 0.66, 0.50)],
        [(0.46, 0.44, 0.40), (0.20, 0.20, 0.22), (0.70, 0.42, 0.30)],
    ]
)


def paint_by_part(parts: np.ndarray, albedos: np.ndarray = TABLE_1) -> np.ndarray:
    """One uniform albedo per part: (n,) part indices to (n, 3) float32, linear; colours come round again."""
    return albedos[np.asarray(parts, np.int64) % len(albedos)].astype(np.float32)


def with_stripes(
    albedo: np.ndarray, x: np.ndarray, striped: np.ndarray, period: float, colour: np.ndarray = STRIPE
) -> np.ndarray:
    """Lay level stripes of a second colour over the vertices that are `striped`, (n,) bool; float32.

    A period, in model units, holds one stripe of either colour, equally wide.
    """
    on = striped & (np.asarray(x)[:, 2] % period < period / 2)
    return np.where(on[:, None], colour, albedo).astype(np.float32)


def paint_for_matching(x: np.ndarray, parts: np.ndarray, finest: float) -> np.ndarray:
    """A stone-like solid texture with detail at every scale from `finest` to fifty times as much.

    Blotches mix two pigments, cells at three sizes speckle, dark veins cross, octaves of grain modulate:
    nothing repeats, so that SIFT finds distinct keypoints and stereo a slope at every pixel.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Surface points, model units.
    parts : ndarray, shape (n,), integer
        Index into `bust.PARTS`.
    finest : float
        Wavelength of the finest grain, model units: about two pixel footprints.

    Returns
    -------
    albedo : ndarray, shape (n, 3), float32
        Linear, within [0.02, 0.9].
    """
    x = np.asarray(x, np.float64)
    pigments = PIGMENTS[np.asarray(parts, np.int64) % len(PIGMENTS)]
    warp = np.stack([smooth_noise(x, 24 * finest, 100 + k) - 0.5 for k in range(3)], axis=-1) * (16 * finest)
    blotch = octaves(x + warp, (40 * finest, 18 * finest, 8 * finest), 0.75, seed=1)
    mix = _step(blotch, 0.5, 0.06)[:, None]
    albedo = (1 - mix) * pigments[:, 0] + mix * pigments[:, 1]
    for spacing, share, seed in ((14 * finest, 0.45, 10), (6.5 * finest, 0.5, 20), (3.2 * finest, 0.4, 30)):
        albedo = _speckled(albedo, x, pigments, spacing, share, seed)
    vein = np.abs(octaves(x + warp, (30 * finest, 12 * finest), 0.6, seed=40) - 0.5)
    albedo *= (0.35 + 0.65 * _step(vein, 0.018, 0.012))[:, None]
    grain = octaves(x, (4 * finest, 2 * finest, finest), 1.0, seed=50)
    return np.clip(albedo * (0.35 + 1.3 * grain)[:, None], 0.02, 0.9).astype(np.float32)


def _speckled(
    albedo: np.ndarray, x: np.ndarray, pigments: np.ndarray, spacing: float, share: float, seed: int
) -> np.ndarray:
    """Lay roundish speckles, some light, some dark, over a `share` of the cells of size `spacing`."""
    distance, value = nearest_cell(x, spacing, seed)
    cover = 1 - _step(distance, 0.36, 0.05)
    colour = np.where((value < 0.62 * share)[:, None], pigments[:, 2], 0.4 * pigments[:, 1])
    return np.where((value < share)[:, None], albedo + cover[:, None] * (colour - albedo), albedo)


def _step(value: np.ndarray, edge: float, width: float) -> np.ndarray:
    """0 below, 1 above `edge`, smooth over ± `width`."""
    t = np.clip((value - edge) / (2 * width) + 0.5, 0, 1)
    return t * t * (3 - 2 * t)
