"""Radial distortion by a polynomial as a ratio of polynomials, which COLMAP's FULL_OPENCV has."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

Radial = tuple[float, float, float, float]  # k₁ to k₄, of r² to r⁸
SAMPLES = 400  # radii at which the two are compared
ROUNDS = 5  # in which the ratio's own denominator weighs the fit


@lru_cache(maxsize=64)  # photos share their lenses
def rational_distortion(radial: Radial, farthest: float) -> tuple[tuple[float, ...], float]:
    """Approximate 1 + k₁ r² + k₂ r⁴ + k₃ r⁶ + k₄ r⁸ by a ratio of polynomials of degree 6.

    Parameters
    ----------
    radial : tuple of float
        k₁ to k₄.
    farthest : float
        r is at most this.

    Returns
    -------
    tuple of 6 floats
        Of r², r⁴ and r⁶ above, then below the line; both polynomials begin with 1.
    float
        The largest difference times r: of the distorted radius, in focal lengths. inf where the ratio has a
        pole.

    Notes
    -----
    (1 + Σ aᵢ uⁱ) = p(u) (1 + Σ bᵢ uⁱ), u = r², is linear in a and b; each round divides by the denominator of
    the one before, so that the ratio itself is fitted (Sanathanan and Koerner 1963). Denominators of one, two
    and three terms are tried: with more than are needed, both share a factor, which may be a pole.
    """
    radius = farthest * np.linspace(0, 1, SAMPLES)[1:]
    u = (radius / farthest) ** 2  # of one size for all coefficients
    powers = np.stack([u, u**2, u**3], axis=1)
    ahead = np.array([k * farthest ** (2 * n) for n, k in enumerate(radial, start=1)])
    wanted = 1 + powers @ ahead[:3] + ahead[3] * u**4
    fits = [_fitted(powers, wanted, radius, terms) for terms in (1, 2, 3)]
    found, off = min(fits, key=lambda fit: fit[1])
    return tuple((found / np.tile([farthest**2, farthest**4, farthest**6], 2)).tolist()), off


def undistorted_radius(radial: Radial, distorted: float) -> float:
    """Invert a radial distortion: the undistorted radius of a distorted one, or the same if it has none."""
    radius = np.linspace(0, 3 * distorted, 3 * SAMPLES)
    reached = radius * (1 + sum(k * radius ** (2 * n) for n, k in enumerate(radial, start=1))) >= distorted
    return float(radius[np.argmax(reached)]) if reached.any() else distorted


def _fitted(
    powers: np.ndarray, wanted: np.ndarray, radius: np.ndarray, terms: int
) -> tuple[np.ndarray, float]:
    """Fit a ratio with so many terms below the line; returns both polynomials, and the largest difference."""
    design = np.concatenate([powers, -wanted[:, None] * powers[:, :terms]], axis=1)
    found, below = np.zeros(6), np.ones(len(radius))
    for _ in range(ROUNDS):
        weight = radius / below
        found[: 3 + terms] = np.linalg.lstsq(weight[:, None] * design, weight * (wanted - 1), rcond=None)[0]
        below = 1 + powers @ found[3:]
        if below.min() <= 0:
            return np.zeros(6), float("inf")
    off = np.abs((1 + powers @ found[:3]) / below - wanted) * radius
    return found, float(off.max())
