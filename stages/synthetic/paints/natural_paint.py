"""Albedo like the world's: a texture at a stated contrast over a paint drawn by seed.

The albedo is ``log ρ = log g + c · (t · 1 + χ₁ w + χ₂ v)``: ground g, contrast c, tone t of mean 0 and
standard deviation 1 over the points, chroma χ along two directions w, v whose components sum to 0. So c is
the standard deviation of the log brightness, brightness being the geometric mean of the three channels.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stages.synthetic.paints.textures.flat import plaster, print_
from stages.synthetic.paints.textures.organic import rust_and_moss, stains, wood
from stages.synthetic.paints.textures.pattern import Pattern, Scale
from stages.synthetic.paints.textures.stone import fractal, masonry, rubble

Texture = Callable[[np.ndarray, Scale, int], Pattern]

TEXTURES: dict[str, Texture] = {
    "fractal": fractal,
    "masonry": masonry,
    "rubble": rubble,
    "wood": wood,
    "rust_and_moss": rust_and_moss,
    "stains": stains,
    "print": print_,
    "plaster": plaster,
}
NATURAL_PAINTS = (*TEXTURES, "quilt")

# Linear red, green, blue of real paints; one of a texture's is drawn by seed.
STONE = ((0.36, 0.32, 0.26), (0.40, 0.29, 0.20), (0.30, 0.30, 0.29), (0.45, 0.38, 0.27), (0.26, 0.20, 0.17))
WOOD = ((0.32, 0.19, 0.10), (0.42, 0.29, 0.17), (0.22, 0.14, 0.09), (0.33, 0.29, 0.24))
PLASTER = (
    (0.62, 0.58, 0.50),
    (0.55, 0.38, 0.24),
    (0.42, 0.47, 0.50),
    (0.56, 0.46, 0.42),
    (0.34, 0.40, 0.30),
    (0.48, 0.22, 0.16),
)
GROUNDS = {"wood": WOOD, "stains": PLASTER, "print": PLASTER, "plaster": PLASTER}

WARM, GREEN = np.array([1.0, 0.0, -1.0]) / np.sqrt(2), np.array([-1.0, 2.0, -1.0]) / np.sqrt(6)
DARKEST, BRIGHTEST = 0.02, 0.9
IN_RANGE = 0.98  # of the points: the ground is darkened until so many are below the brightest


def natural_paint(name: str, x: np.ndarray, scale: Scale, contrast: float, seed: int) -> np.ndarray:
    """Evaluate a texture at points.

    Parameters
    ----------
    name : str
        A key of `TEXTURES`.
    x : ndarray, shape (n, 3)
        Surface points, model units; the contrast is that over these.
    scale : Scale
    contrast : float
        Standard deviation of the log of brightness, 0.05 to 0.6.
    seed : int
        Draws the ground, the layout and the noise.

    Returns
    -------
    albedo : ndarray, shape (n, 3), float32
        Linear, within [0.02, 0.9]; the ground is darkened until 98 % are below 0.9, the rest is clipped.
    """
    pattern = TEXTURES[name](np.asarray(x, np.float64), scale, 10_000 * (seed + 1))
    grounds = GROUNDS.get(name, STONE)
    ground = np.array(grounds[np.random.default_rng(seed).integers(len(grounds))])
    log = pattern.tone[:, None] + pattern.chroma[:, :1] * WARM + pattern.chroma[:, 1:] * GREEN
    albedo = ground * np.exp(contrast * log)
    albedo *= min(1.0, BRIGHTEST / np.quantile(albedo.max(axis=1), IN_RANGE))
    return np.clip(albedo, DARKEST, BRIGHTEST).astype(np.float32)


def quilt(
    x: np.ndarray, parts: np.ndarray, scale: Scale, contrast: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Give every part a texture of its own, plain plaster among them.

    Returns
    -------
    albedo : ndarray, shape (n, 3), float32
        As of `natural_paint`; the contrast is that within each part.
    plain : ndarray, shape (n,), bool
        Where the paint is plain plaster.
    """
    names = names_of_quilt(int(parts.max()) + 1, seed)
    albedo, plain = np.empty((len(x), 3), np.float32), np.zeros(len(x), bool)
    for part in np.unique(parts):
        here = parts == part
        albedo[here] = natural_paint(names[part], x[here], scale, contrast, seed + 100 * int(part))
        plain |= here & (names[part] == "plaster")
    return albedo, plain


def names_of_quilt(count: int, seed: int) -> list[str]:
    """Draw the textures of `count` parts: each once before any comes again, plaster on every fourth part."""
    rng = np.random.default_rng(seed)
    others = [name for name in TEXTURES if name != "plaster"]
    drawn = [name for _ in range(count // len(others) + 1) for name in rng.permutation(others)]
    first = rng.integers(min(4, count))
    return ["plaster" if k % 4 == first else str(drawn[k]) for k in range(count)]
