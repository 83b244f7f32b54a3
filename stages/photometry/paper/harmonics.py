"""Real spherical harmonics and their shading basis for a convex Lambertian surface."""

from __future__ import annotations

from math import factorial, pi, sqrt

import numpy as np


def real_harmonics(directions: np.ndarray, degree: int) -> np.ndarray:
    """Evaluate real orthonormal spherical harmonics without Condon–Shortley phase, ordered by (l, m).

    Parameters
    ----------
    directions : ndarray, shape (..., 3)
        Unit vectors; the polar axis is z.
    degree : int
        Largest l.

    Returns
    -------
    ndarray, shape (..., (degree + 1)²), float64
        Y_00, Y_1−1, Y_10, Y_11, …; the first four are ``[½, √¾ y, √¾ z, √¾ x] / √π``.

    Notes
    -----
    ``Y_lm = K_lm Q_lm(z) c_m(x, y)`` with ``c_m = √2 Re (x + iy)^m`` for m > 0, ``√2 Im (x + iy)^|m|`` for
    m < 0, 1 for m = 0, ``K_lm² = (2l + 1)/(4π) · (l − |m|)!/(l + |m|)!``, and Q_lm the associated Legendre
    function over sin^m θ: ``Q_mm = (2m − 1)!!`` and
    ``(l − m) Q_lm = (2l − 1) z Q_(l−1)m − (l + m − 1) Q_(l−2)m``.
    """
    directions = np.asarray(directions, np.float64)
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    values = np.empty((*directions.shape[:-1], (degree + 1) ** 2))
    for m in range(degree + 1):
        cosine, sine = _powers(x, y, m)
        for l, q in enumerate(_legendre(z, m, degree), start=m):  # noqa: E741 — the conventional letter
            scale = sqrt((2 * l + 1) / (4 * pi) * factorial(l - m) / factorial(l + m))
            centre = l * l + l
            values[..., centre + m] = scale * q * cosine
            if m > 0:
                values[..., centre - m] = scale * q * sine
    return values


def clamped_cosine(degree: int) -> np.ndarray:
    """List A_l of the clamped cosine max(0, cos θ), shape (degree + 1,): π, 2π/3, π/4, 0, −π/24, 0, …"""
    return np.array([_clamped_cosine(l) for l in range(degree + 1)])  # noqa: E741


def shading_basis(normals_in_world: np.ndarray, degree: int = 2) -> np.ndarray:
    """Evaluate ν(p) of the shading ``S = σ·ν`` of a surface with unobstructed sky; for degree 2

    Eq. 1: ``I^i(p) = ρ^i(p) σ^i·ν^i(p)`` with ``ν_k = (A_l/π) Y_k(n)``, k = 1 … 9.

    Parameters
    ----------
    normals_in_world : ndarray, shape (..., 3)
        Unit normals, in world axes so that one light can be shared by all views.
    degree : int
        Largest l; the paper's nine harmonics have 2.

    Returns
    -------
    ndarray, shape (..., (degree + 1)²), float64
    """
    per_harmonic = np.repeat(clamped_cosine(degree) / pi, 2 * np.arange(degree + 1) + 1)
    return real_harmonics(normals_in_world, degree) * per_harmonic


def _powers(x: np.ndarray, y: np.ndarray, m: int) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate ``√2 Re (x + iy)^m`` and ``√2 Im (x + iy)^m``; 1 and 0 for m = 0."""
    if m == 0:
        return np.ones_like(x), np.zeros_like(x)
    power = (x + 1j * y) ** m
    return sqrt(2) * power.real, sqrt(2) * power.imag


def _legendre(z: np.ndarray, m: int, degree: int) -> list[np.ndarray]:
    """Evaluate Q_lm(z) for l = m … degree."""
    functions = [np.full_like(z, float(np.prod(np.arange(1, 2 * m, 2))))]
    for l in range(m + 1, degree + 1):  # noqa: E741
        below = functions[l - m - 2] if l - m >= 2 else 0.0
        functions.append(((2 * l - 1) * z * functions[-1] - (l + m - 1) * below) / (l - m))
    return functions


def _clamped_cosine(l: int) -> float:  # noqa: E741
    if l == 1:
        return 2 * pi / 3
    if l % 2:
        return 0.0
    half = l // 2
    sign = -1 if half % 2 == 0 else 1
    if l == 0:
        return pi
    return sign * 2 * pi / ((l + 2) * (l - 1)) * factorial(l) / (2**l * factorial(half) ** 2)
