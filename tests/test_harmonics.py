"""Harmonics: orthonormal, in the stated order and sign, and the shading of a sky (Eq. 1)."""

import numpy as np
import pytest

from stages.photometry.paper.harmonics import clamped_cosine, real_harmonics, shading_basis


def sphere_quadrature(rings: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Directions and weights that integrate polynomials of degree 2·rings − 1 over the sphere exactly."""
    z, weights = np.polynomial.legendre.leggauss(rings)
    angles = 2 * np.pi * np.arange(2 * rings) / (2 * rings)
    z, angle = np.meshgrid(z, angles, indexing="ij")
    radius = np.sqrt(1 - z * z)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
    return directions.reshape(-1, 3), np.repeat(weights, 2 * rings) * np.pi / rings


def test_harmonics_are_orthonormal_up_to_degree_five():
    directions, weights = sphere_quadrature()
    values = real_harmonics(directions, 5)
    assert np.allclose(values.T @ (weights[:, None] * values), np.eye(36), atol=1e-12)


def test_the_first_nine_are_the_polynomials_known_by_hand():
    x, y, z = n = np.array([0.48, -0.6, 0.64])
    by_hand = [
        0.28209479177387814,
        0.4886025119029199 * y,
        0.4886025119029199 * z,
        0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        1.0925484305920792 * y * z,
        0.31539156525252005 * (3 * z * z - 1),
        1.0925484305920792 * x * z,
        0.5462742152960396 * (x * x - y * y),
    ]
    assert np.allclose(real_harmonics(n, 2), by_hand, atol=1e-15)


@pytest.mark.parametrize("degree", range(7))
def test_the_clamped_cosine_is_the_integral_of_cosine_times_legendre(degree):
    t, weights = np.polynomial.legendre.leggauss(40)
    t, weights = (t + 1) / 2, weights / 2
    legendre = np.polynomial.legendre.Legendre.basis(degree)(t)
    assert clamped_cosine(degree)[degree] == pytest.approx(
        2 * np.pi * np.sum(weights * t * legendre), abs=1e-12
    )


def test_the_basis_weighs_harmonics_by_the_clamped_cosine_of_their_degree():
    n = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    per_harmonic = [1] + 3 * [2 / 3] + 5 * [1 / 4]
    assert np.allclose(shading_basis(n), real_harmonics(n, 2) * per_harmonic)


def test_eq_1_a_uniform_sky_lights_all_normals_alike():
    """Eq. 1 with radiance 1 everywhere: σ = (√4π, 0, …), irradiance/π = 1, so that I = ρ."""
    directions, weights = sphere_quadrature()
    light = real_harmonics(directions, 2).T @ weights
    assert np.allclose(shading_basis(directions[::7]) @ light, 1.0)


def test_eq_1_shading_is_the_cosine_weighted_integral_of_the_sky():
    """Eq. 1: ``σ·ν(n) = 1/π ∫ L(ω) max(0, n·ω) dω`` for a sky L of degree 2, n = (0, 0, 1)."""
    directions, weights = sphere_quadrature(200)
    light = np.array([1.0, 0.3, -0.2, 0.5, 0.1, 0.2, -0.4, 0.3, 0.25])
    sky = real_harmonics(directions, 2) @ light
    integral = np.sum(weights * sky * np.maximum(0, directions[:, 2])) / np.pi
    assert shading_basis(np.array([0.0, 0.0, 1.0])) @ light == pytest.approx(integral, abs=1e-4)
