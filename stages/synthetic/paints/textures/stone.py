"""Stone: bare, in courses with mortar, in rubble with mortar."""

from __future__ import annotations

import numpy as np

from stages.synthetic.paints.solid_noise import cell_borders, fractal_noise, lattice_random
from stages.synthetic.paints.textures.pattern import Pattern, Scale, smooth_step, standardised, stone_colour

COURSE = 0.13  # height of a course, in units of the largest wavelength
OBLIQUE_DEG = 32.0  # joints run obliquely to x and y: no flat wall lies within a joint
JOINT = 0.10  # share of a course; never thinner than a detail that can be drawn
RUBBLE = 0.18  # size of a rubble stone, in units of the largest wavelength
MORTAR_TONE = 1.6  # brighter or darker than the mean stone, in deviations between stones


def fractal(x: np.ndarray, scale: Scale, seed: int) -> Pattern:
    """Brightness with a 1/f spectrum, and colour with another that is partly correlated."""
    tone = standardised(fractal_noise(x, scale.largest, scale.finest, seed))
    return Pattern(tone, stone_colour(x, tone, scale, seed + 100))


def masonry(x: np.ndarray, scale: Scale, seed: int) -> Pattern:
    """Courses of blocks of unequal length, each with a tone and a grain of its own, and mortar."""
    height = COURSE * scale.largest
    uneven = np.stack([fractal_noise(x, height, height / 4, seed + 10 * k) for k in range(3)], axis=-1)
    warped = x + 0.03 * height * uneven
    phase = np.random.default_rng(seed).uniform(0, 1, 3)
    angle = np.deg2rad(OBLIQUE_DEG)
    along = warped @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)], [0, 0]])
    course = warped[:, 2] / height + phase[0]
    row = np.floor(course).astype(np.int64)
    lengths = np.array([2.1, 2.7]) * height
    shift = np.stack([lattice_random(_keys(row, k), seed + 1) for k in range(2)], axis=-1)
    block = along / lengths + phase[1:] + shift
    cell = np.floor(block).astype(np.int64)
    to_joint = np.minimum(_to_integer(course) * height, (_to_integer(block) * lengths).min(axis=-1))
    value = lattice_random(np.stack([row, cell[:, 0], cell[:, 1]], axis=-1), seed + 2)
    return _stones_with_mortar(x, value, to_joint, JOINT * height, scale, seed)


def rubble(x: np.ndarray, scale: Scale, seed: int) -> Pattern:
    """Stones of irregular shape, flatter than wide, each with a tone and a grain of its own, and mortar."""
    size = RUBBLE * scale.largest
    uneven = np.stack([fractal_noise(x, size, size / 4, seed + 10 * k) for k in range(3)], axis=-1)
    flattened = (x + 0.04 * size * uneven) * [1, 1, 1.5]
    distance, value = cell_borders(flattened, size, seed + 1)
    return _stones_with_mortar(x, value, distance * size, 0.5 * JOINT * size, scale, seed)


def _stones_with_mortar(
    x: np.ndarray, value: np.ndarray, to_joint: np.ndarray, joint: float, scale: Scale, seed: int
) -> Pattern:
    """Give each stone, by its random number, a tone and a colour; add 1/f grain; lay mortar in the joints."""
    rng = np.random.default_rng(seed + 5)
    grain = fractal_noise(x, 2 * COURSE * scale.largest, scale.finest, seed + 60)
    of_stone = np.sqrt(12) * (value - 0.5)
    other = np.sqrt(12) * (value * 977 % 1 - 0.5)  # a second number, independent of the first
    half = max(joint, 0.7 * scale.finest) / 2
    mortar = 1 - smooth_step(to_joint, half, half / 2)
    tone_of_mortar = MORTAR_TONE * rng.choice([-1.0, 1.0])
    tone = (1 - mortar) * (0.8 * of_stone + 0.6 * grain) + mortar * (tone_of_mortar + 0.3 * grain)
    tone = standardised(tone)
    chroma = stone_colour(x, tone, scale, seed + 100)
    chroma[:, 0] += (1 - mortar) * 0.35 * other
    return Pattern(tone, chroma)


def _keys(row: np.ndarray, kind: int) -> np.ndarray:
    return np.stack([row, np.full_like(row, kind), np.zeros_like(row)], axis=-1)


def _to_integer(values: np.ndarray) -> np.ndarray:
    return np.abs(values - np.round(values))
