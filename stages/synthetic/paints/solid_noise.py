"""Deterministic noise that fills space: smooth octaves, 1/f noise, cells each with its own random number.

Randomness comes from an integer hash of lattice coordinates, so that the same point has the same value on
every machine, in whatever order and number points are asked for.
"""

from __future__ import annotations

import numpy as np

# Of `smooth_noise` over space: corners are uniform, √(1/12), and the quintic weights s of the three axes
# leave E[s² + (1 − s)²] = 2 · 181/462 of the variance each.
SMOOTH_NOISE_DEVIATION = float(np.sqrt((2 * 181 / 462) ** 3 / 12))


def lattice_random(cell: np.ndarray, seed: int) -> np.ndarray:
    """A number in [0, 1) for every lattice cell, (..., 3) int64 to (...) float64."""
    with np.errstate(over="ignore"):
        key = cell.astype(np.int64).view(np.uint64)
        mixed = key[..., 0] * np.uint64(0x9E3779B97F4A7C15) ^ key[..., 1] * np.uint64(0xC2B2AE3D27D4EB4F)
        mixed = (
            mixed ^ key[..., 2] * np.uint64(0x165667B19E3779F9) ^ np.uint64(seed * 0x27D4EB2F165667C5 % 2**64)
        )
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            mixed = (mixed ^ mixed >> np.uint64(shift)) * np.uint64(factor)
        mixed = mixed ^ mixed >> np.uint64(31)
    return (mixed >> np.uint64(11)).astype(np.float64) / 2.0**53


def smooth_noise(x: np.ndarray, wavelength: float, seed: int) -> np.ndarray:
    """Values in [0, 1] at points (n, 3): random at lattice points `wavelength` apart, smooth in between."""
    scaled = x / wavelength
    base = np.floor(scaled).astype(np.int64)
    t = scaled - base
    t = t * t * t * (t * (6 * t - 15) + 10)
    total = np.zeros(len(x))
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(np.array(corner, bool), t, 1 - t).prod(axis=-1)
        total += weight * lattice_random(base + np.array(corner), seed)
    return total


def octaves(x: np.ndarray, wavelengths: tuple[float, ...], gain: float, seed: int) -> np.ndarray:
    """Weighted mean of smooth noise over `wavelengths`, each weighing `gain` times the last; in [0, 1]."""
    weights = gain ** np.arange(len(wavelengths))
    layers = [
        w * smooth_noise(x, length, seed + k)
        for k, (w, length) in enumerate(zip(weights, wavelengths, strict=True))
    ]
    return np.sum(layers, axis=0) / weights.sum()


def fractal_noise(
    x: np.ndarray, coarsest: float, finest: float, seed: int, stretch: tuple[float, ...] = (1.0, 1.0, 1.0)
) -> np.ndarray:
    """Sum octaves of equal power from wavelength `coarsest` down to `finest`; mean 0, deviation about 1.

    Equal power per octave gives an amplitude spectrum proportional to 1/f on any plane through the volume.
    Each octave has a lattice of its own direction, so that no axis shows.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
    coarsest, finest : float
        Lattice spacings, model units; no octave is finer than `finest`.
    seed : int
    stretch : tuple of float
        Elongation along x, y, z, as of fibres; 1 for none. Stretched lattices keep their axes.
    """
    wavelengths = octave_wavelengths(coarsest, finest)
    total = np.zeros(len(x))
    for k, wavelength in enumerate(wavelengths):
        if stretch == (1.0, 1.0, 1.0):
            lattice = x @ _random_rotation(seed + k).T
        else:
            lattice = x / np.array(stretch)
        total += (smooth_noise(lattice, wavelength, seed + k) - 0.5) / SMOOTH_NOISE_DEVIATION
    return total / np.sqrt(len(wavelengths))


def octave_wavelengths(coarsest: float, finest: float) -> list[float]:
    """Wavelengths from `coarsest`, each half of the last, none below `finest`; `coarsest` at least."""
    count = 1 + max(0, int(np.floor(np.log2(coarsest / finest) + 1e-9)))
    return [coarsest / 2**k for k in range(count)]


def _random_rotation(seed: int) -> np.ndarray:
    """Draw a rotation, shape (3, 3)."""
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return q * np.sign(np.diag(r))


def nearest_cell(x: np.ndarray, spacing: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Scatter one point in each cube of side `spacing`; find each x's nearest.

    Returns
    -------
    distance : ndarray, shape (n,)
        In units of `spacing`.
    value : ndarray, shape (n,)
        The nearest point's own random number in [0, 1).
    """
    scaled = x / spacing
    base = np.floor(scaled).astype(np.int64)
    best, value = np.full(len(x), np.inf), np.zeros(len(x))
    for offset in np.ndindex(3, 3, 3):
        cell = base + np.array(offset) - 1
        point = cell + np.stack([lattice_random(cell, seed + k) for k in range(3)], axis=-1)
        squared = ((scaled - point) ** 2).sum(axis=-1)
        closer = squared < best
        best[closer] = squared[closer]
        value[closer] = lattice_random(cell[closer], seed + 3)
    return np.sqrt(best), value


def cell_borders(
    x: np.ndarray, spacing: float, seed: int, jitter: float = 0.8
) -> tuple[np.ndarray, np.ndarray]:
    """Divide space into the Voronoi cells of one scattered point per cube of side `spacing`.

    Returns
    -------
    distance : ndarray, shape (n,)
        To the border of the cell, in units of `spacing`.
    value : ndarray, shape (n,)
        The nearest point's own random number in [0, 1).
    """
    scaled = x / spacing
    base = np.floor(scaled).astype(np.int64)
    cells = [base + np.array(offset) - 1 for offset in np.ndindex(3, 3, 3)]
    sites = [cell + 0.5 + jitter * (_scatter(cell, seed) - 0.5) for cell in cells]
    squared = np.stack([((scaled - site) ** 2).sum(axis=-1) for site in sites])
    nearest = squared.argmin(axis=0)
    own_cell = np.take_along_axis(np.stack(cells), nearest[None, :, None], axis=0)[0]
    own_site = np.take_along_axis(np.stack(sites), nearest[None, :, None], axis=0)[0]
    distance = np.full(len(x), np.inf)
    for site, other in zip(sites, squared, strict=True):
        apart = np.linalg.norm(site - own_site, axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            to_plane = (other - squared.min(axis=0)) / (2 * apart)
        distance = np.where(apart > 0, np.minimum(distance, to_plane), distance)
    return distance, lattice_random(own_cell, seed + 3)


def _scatter(cell: np.ndarray, seed: int) -> np.ndarray:
    return np.stack([lattice_random(cell, seed + k) for k in range(3)], axis=-1)
