"""Deterministic noise that fills space: smooth octaves, and cells each with its own random number.

Randomness comes from an integer hash of lattice coordinates, so that the same point has the same value on
every machine, in whatever order and number points are asked for.
"""

from __future__ import annotations

import numpy as np


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
