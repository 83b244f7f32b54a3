"""Transfer vectors against what is known by hand: open surfaces, bowls, cones, closed rooms."""

import numpy as np
import pytest

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.occluders import Occluders
from stages.geometry.rays import vertex_normals
from stages.photometry.paper.harmonics import real_harmonics, shading_basis
from stages.photometry.transport.interreflection import bounced
from stages.photometry.transport.transfer_vectors import Occlusion, around, cosine_spiral, occlusion, tangents
from tests.bowls import bowl, cone

DIRECTIONS = 512
OFF = 1e-3  # of the surface, where rays begin


def seen_from(surface: Surface, degree: int = 2) -> tuple[Occlusion, np.ndarray]:
    """Occlusion of all vertices, and their normals."""
    normals = vertex_normals(surface.vertices, surface.faces).astype(float)
    caster = Occluders(surface, threads=2)
    origins = surface.vertices - caster.origin + OFF * normals
    return occlusion(origins, normals, caster.cast, len(origins), degree, DIRECTIONS), normals


def under_uniform_sky(transfer: np.ndarray) -> np.ndarray:
    """Shading by a sky of radiance 1: only Y_00 sees it."""
    return transfer[:, 0] * np.sqrt(4 * np.pi)


@pytest.mark.parametrize("count", [64, 256])
def test_the_spiral_stands_for_the_clamped_cosine(count):
    """Harmonics averaged over it are ν, to the error of so few directions."""
    normals = np.random.default_rng(0).normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    towards = around(normals, cosine_spiral(count), np.arange(50))
    found = real_harmonics(towards, 4).reshape(50, count, 25).mean(axis=1)
    assert np.abs(found - shading_basis(normals, 4)).max() < 1.5 / count


def test_tangents_make_a_right_handed_frame_even_at_the_poles():
    normals = np.array([[0, 0, 1], [0, 0, -1], [1e-9, 0, -1], [0.6, 0.48, 0.64], [0.6, 0.48, -0.64]])
    first, second = tangents(normals)
    frames = np.stack([first, second, normals], axis=1)
    assert np.allclose(frames @ frames.swapaxes(1, 2), np.eye(3), atol=1e-8)
    assert np.allclose(np.linalg.det(frames), 1)


def test_an_unoccluded_point_has_exactly_the_open_skys_transfer():
    """(A_l/π) Y_k(n) for every k, of which l = 3 is 0 and l = 4 is −1/24 of Y."""
    flat = Surface(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]], np.int32))
    seen, normals = seen_from(flat, degree=4)
    assert not seen.blocked.any() and seen.form_factors.nnz == seen.behind.nnz == 0
    transfer, harmonics = shading_basis(normals, 4) - seen.blocked, real_harmonics(normals, 4)
    assert np.allclose(transfer[:, 9:16], 0)
    assert np.allclose(transfer[:, 16:], -harmonics[:, 16:] / 24)


@pytest.mark.parametrize("half_angle_deg", [30, 45, 60])
def test_the_bottom_of_a_cone_gets_sin_squared_of_the_open_sky(half_angle_deg):
    surface = cone(half_angle_deg)
    caster = Occluders(surface)
    up = np.array([[0.0, 0.0, 1.0]])
    bottom = np.array([[0.0, 0.0, OFF]]) - caster.origin
    seen = occlusion(bottom, up, caster.cast, len(surface.vertices), 2, 4096)
    open_share = under_uniform_sky(shading_basis(up) - seen.blocked)[0]
    assert open_share == pytest.approx(np.sin(np.radians(half_angle_deg)) ** 2, abs=0.005)


@pytest.mark.parametrize("depth", [0.25, 0.5, 0.8])
@pytest.mark.parametrize("albedo", [0.3, 0.8])
def test_in_a_spherical_bowl_light_is_even_and_bounces_add_a_geometric_series(depth, albedo):
    """Every point of a sphere sees every other alike: 1 − f of the sky, (1 − f)/(1 − ρ f) with bounces."""
    seen, normals = seen_from(bowl(depth))
    direct = shading_basis(normals) - seen.blocked
    inner = slice(0, -120)  # but for the rim, where facets and offset weigh
    shading = under_uniform_sky(direct)[inner]
    assert np.median(shading) == pytest.approx(1 - depth, abs=0.01)
    assert np.abs(shading - (1 - depth)).max() < 0.06
    total = under_uniform_sky(bounced(direct, seen, np.full((len(direct), 1), albedo), 0.0, bounces=60))[
        inner
    ]
    assert np.median(total) == pytest.approx((1 - depth) / (1 - albedo * depth), rel=0.02)


def test_shares_of_sky_front_and_back_add_up_to_one():
    seen, normals = seen_from(bowl(0.5))
    blocked = under_uniform_sky(seen.blocked)
    shares = np.asarray(seen.form_factors.sum(axis=1)).ravel() + np.asarray(seen.behind.sum(axis=1)).ravel()
    assert np.allclose(shares, blocked, atol=1e-5)
    assert seen.behind.nnz == 0


def test_surface_met_from_behind_is_told_apart():
    """A sheet above a floor that shows it its back."""
    floor, wide = np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]), 50.0
    roof = np.array([[-wide, -wide, 1], [wide, -wide, 1], [0, wide, 1]])
    surface = Surface(np.concatenate([floor, roof]), np.array([[0, 1, 2], [3, 4, 5]], np.int32))
    seen, _ = seen_from(surface)
    assert np.asarray(seen.behind.sum(axis=1)).ravel()[:3] == pytest.approx(1, abs=0.02)
    assert seen.form_factors[:3].nnz == 0
    direct = np.ones((6, 9))
    lit = bounced(direct, seen, np.zeros((6, 1)), of_backs=0.5, bounces=1)
    assert lit[:3] == pytest.approx(1.5, abs=0.02)
    assert lit[3:] == pytest.approx(1.0)


def test_no_bounce_or_black_surface_leaves_the_direct_transfer():
    seen, normals = seen_from(bowl(0.5, rings=10, around=20))
    direct = shading_basis(normals) - seen.blocked
    assert bounced(direct, seen, np.full((len(direct), 1), 0.8), 0.8, bounces=0) is direct
    assert np.array_equal(bounced(direct, seen, np.zeros((len(direct), 1)), 0.0, bounces=3), direct)


def test_occlusion_is_the_same_whatever_the_threads():
    surface = bowl(0.5, rings=160, around=160)
    normals = vertex_normals(surface.vertices, surface.faces)
    found = []
    for threads in (1, 2):
        caster = Occluders(surface, threads)
        origins = surface.vertices - caster.origin + OFF * normals
        few = slice(0, None, 50)
        found.append(occlusion(origins[few], normals[few], caster.cast, len(origins), 4, 64))
    assert np.array_equal(found[0].blocked, found[1].blocked)
    for name in ("form_factors", "behind"):
        one, two = (getattr(each, name) for each in found)
        assert (one != two).nnz == 0
