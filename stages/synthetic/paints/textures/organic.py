"""Wood; rust and moss on stone; soft stains on plaster."""

from __future__ import annotations

import numpy as np

from stages.synthetic.paints.solid_noise import fractal_noise, lattice_random
from stages.synthetic.paints.textures.pattern import Pattern, Scale, smooth_step, standardised, stone_colour

BOARD = 0.30  # width of a board, in units of the largest wavelength
RING = 0.055  # distance of year rings
FIBRE = (1.0, 1.0, 14.0)  # fibres run along z
RUST, MOSS = np.array([2.6, -0.15]), np.array([1.3, 1.5])  # chroma, see `Pattern`
STAIN = np.array([0.5, 0.1])


def wood(x: np.ndarray, scale: Scale, seed: int) -> Pattern:
    """Upright boards cut from trunks of their own: year rings, fibres, dark gaps between the boards."""
    rng = np.random.default_rng(seed)
    width, ring = BOARD * scale.largest, max(RING * scale.largest, 2 * scale.finest)
    angle = np.deg2rad(rng.uniform(20, 70))
    across = x[:, :2] @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    board = across / width + rng.uniform(0, 1, 2)
    cell = np.floor(board).astype(np.int64)
    keys = np.concatenate([cell, np.zeros((len(x), 1), np.int64)], axis=1)
    own = np.stack([lattice_random(keys, seed + k) for k in range(4)], axis=-1)
    axis = (own[:, :2] - 0.5) * 2.5 * width  # where the trunk's core lies, from the board's middle
    wander = np.stack(
        [fractal_noise(x + 7 * own[:, 2:3], 2 * width, width / 4, seed + 10 * k, FIBRE) for k in range(2)],
        axis=-1,
    )
    radius = np.linalg.norm((board - cell - 0.5) * width - axis + 0.35 * ring * wander, axis=-1)
    phase = radius / ring % 1
    late = phase**2 * (1 - smooth_step(phase, 0.93, 0.07))  # darkens slowly, ends abruptly
    fibre = fractal_noise(x, width / 4, scale.finest, seed + 50, FIBRE)
    to_gap = np.abs(board - np.round(board)).min(axis=-1) * width
    gap = 1 - smooth_step(to_gap, 0.5 * scale.finest, 0.4 * scale.finest)
    tone = -2.2 * late + 0.45 * fibre + 1.2 * (own[:, 3] - 0.5) - 2.5 * gap
    tone = standardised(tone)
    return Pattern(tone, np.stack([-0.35 * tone, -0.05 * tone], axis=-1))


def rust_and_moss(x: np.ndarray, scale: Scale, seed: int) -> Pattern:
    """Stone with patches of rust, whose borders are soft, and of moss, whose borders are hard."""
    grain = standardised(fractal_noise(x, scale.largest, scale.finest, seed))
    chroma = stone_colour(x, grain, scale, seed + 100)
    rusty = fractal_noise(x, scale.largest / 1.5, scale.finest, seed + 200)
    rust = smooth_step(rusty, 0.7, 0.6)
    mossy = fractal_noise(x * [1, 1, 0.8], scale.largest / 2, scale.finest, seed + 300)
    moss = smooth_step(mossy - 0.4 * rust, 0.9, 0.1)
    tone = 0.7 * grain - 1.1 * rust
    tone = (1 - moss) * tone + moss * (
        -1.3 + 0.8 * fractal_noise(x, scale.largest / 8, scale.finest, seed + 400)
    )
    chroma = chroma + rust[:, None] * RUST
    chroma = (1 - moss[:, None]) * chroma + moss[:, None] * MOSS
    return Pattern(standardised(tone), chroma)


def stains(x: np.ndarray, scale: Scale, seed: int) -> Pattern:
    """Large stains without any edge, and drips below them, on flat plaster."""
    damp = fractal_noise(x * [1, 1, 0.7], scale.largest, scale.largest / 3, seed)
    drips = fractal_noise(x, scale.largest / 4, scale.largest / 8, seed + 50, (1.0, 1.0, 5.0))
    stain = smooth_step(damp, 0.5, 1.2) + 0.35 * smooth_step(drips, 0.6, 1.0) * smooth_step(damp, 0.0, 1.0)
    return Pattern(standardised(-stain), stain[:, None] * STAIN)
