"""From vertices to pixels: blends, the direct basis, bounces, and the absolute scale of albedo."""

import numpy as np
import pytest
import scipy.sparse as sp

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.decimation.proxy import blend_of, short_edged_with_proxy
from stages.geometry.rays import vertex_normals
from stages.geometry.settings import ProxySettings
from stages.geometry.vertex_interpolation import blend_of_pixels
from stages.photometry.paper.harmonics import shading_basis
from stages.photometry.transport.pixel_transfer import (
    Bounces,
    PixelTransfer,
    at_vertices,
    nearest_shown,
    on_absolute_scale,
)
from stages.photometry.transport.transfer_vectors import Occlusion, Proxy
from tests.bowls import bowl

VERTICES, PIXELS = 5, 12


@pytest.fixture
def transfer() -> PixelTransfer:
    """Random blends of vertices that see a third of each other, degree 1."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(PIXELS + VERTICES, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    shares = rng.random((PIXELS, VERTICES)) * (rng.random((PIXELS, VERTICES)) < 0.5)
    shares[:, 0] += 0.1
    shares[:, 4] = 0  # which no pixel sees
    blend = sp.csr_array((shares / shares.sum(axis=1, keepdims=True)).astype(np.float32))
    factors = sp.csr_array((rng.random((VERTICES, VERTICES)) / 3 / VERTICES).astype(np.float32))
    seen = Occlusion(0.05 * rng.random((VERTICES, 9)).astype(np.float32), factors, 0 * factors)
    normals[PIXELS:, 2] = np.abs(normals[PIXELS:, 2])  # all of a side
    normals[:PIXELS] = blend @ normals[PIXELS:]
    normals[:PIXELS] /= np.linalg.norm(normals[:PIXELS], axis=1, keepdims=True)
    line = np.array([0.0, 1, 2, 4, 3.2])[:, None] * [1.0, 0.5, 0]
    proxy = Proxy(line, normals[PIXELS:], seen)
    transfer, opposed = PixelTransfer.of(normals[:PIXELS], blend, proxy, degree=1)
    assert opposed == 0
    return transfer


def proxy_of(surface: Surface, most_vertices: int) -> Surface:
    """Of a mesh whose edges are short."""
    return short_edged_with_proxy(surface, np.inf, most_vertices, ProxySettings())[1]


def test_the_direct_basis_is_the_open_skys_less_what_is_blocked(transfer):
    assert transfer.direct().shape == (PIXELS, 4)
    lacking = transfer.blend.toarray() @ transfer.occlusion.blocked
    assert np.allclose(transfer.direct(), transfer.open_sky - lacking, atol=1e-6)


def test_black_surface_sends_nothing_on_and_each_channel_has_its_own_bounces(transfer):
    albedo = np.ones((PIXELS, 3)) * [0.0, 0.4, 0.8]
    basis = transfer.with_bounces(albedo, Bounces(count=3, brightest=0.8, quantile=0.99))
    assert basis.shape == (PIXELS, 4, 3)
    assert np.array_equal(basis[:, :, 0], transfer.direct())
    once = (
        transfer.with_bounces(albedo, Bounces(count=1, brightest=0.8, quantile=0.99))
        - transfer.direct()[:, :, None]
    )
    assert np.allclose(once[:, :, 2], 2 * once[:, :, 1], atol=1e-6)
    assert np.array_equal(
        basis, transfer.with_bounces(3 * albedo, Bounces(count=3, brightest=0.8, quantile=0.99))
    )


def test_no_surface_sends_on_more_than_95_percent_however_bright_a_speck_is(transfer):
    speck = np.ones((PIXELS, 3))
    speck[0] = 50
    most, own = (
        transfer.with_bounces(albedo, Bounces(count=3, brightest=0.95, quantile=0.99))
        for albedo in (0 * speck + 1, speck)
    )
    sent_on = np.abs(own - transfer.direct()[:, :, None]).max()
    assert 0 < sent_on <= np.abs(most - transfer.direct()[:, :, None]).max() + 1e-6


def test_without_bounces_the_channels_share_the_direct_basis(transfer):
    basis = transfer.with_bounces(np.ones((PIXELS, 3)), Bounces(count=0, brightest=0.8, quantile=0.99))
    assert all(np.array_equal(basis[:, :, c], transfer.direct()) for c in range(3))


def test_vertices_get_the_mean_of_their_pixels_and_unseen_ones_that_of_their_nearest(transfer):
    values = np.random.default_rng(1).random(PIXELS)
    found, shares = transfer.at_vertices(values), transfer.blend.toarray()
    for vertex in range(VERTICES - 1):
        assert found[vertex] == pytest.approx(np.average(values, weights=shares[:, vertex]), rel=1e-5)
    assert found[4] == found[3]


def test_between_pixels_that_lie_apart_a_fine_mesh_has_the_paint_of_the_nearest():
    """Half of a line of a hundred vertices black, half white; every fifth is shown. Nothing shown: median."""
    line = np.linspace(0, 1, 100)[:, None] * [1.0, 0, 0]
    shown = np.arange(2, 100, 5)
    blend = sp.csr_array((np.ones(20, np.float32), (np.arange(20), shown)), shape=(20, 100))
    paint = at_vertices(blend, nearest_shown(blend, line), (shown >= 50).astype(float))
    assert np.array_equal(paint, np.arange(100) >= 50)
    unseen = sp.csr_array((3, 100), dtype=np.float32)
    assert (at_vertices(unseen, nearest_shown(unseen, line), np.array([1.0, 2, 6])) == 2).all()


def test_the_brightest_material_reflects_what_is_said():
    albedo = np.linspace(0, 2, 1000).reshape(-1, 1) * np.ones(3)
    scaled = on_absolute_scale(albedo, 0.8, 0.99)
    assert np.quantile(scaled, 0.99) == pytest.approx(0.8)
    assert on_absolute_scale(-albedo, 0.8, 0.99).min() == 0
    assert not on_absolute_scale(np.zeros((4, 3)), 0.8, 0.99).any()


def test_pixels_are_blends_of_their_faces_corners():
    surface = bowl(0.5, rings=4, around=8)
    corners, weights = blend_of(surface, np.zeros((0, 3)), surface, ProxySettings())
    rng = np.random.default_rng(2)
    faces = [rng.integers(0, len(surface.faces), 6), rng.integers(0, len(surface.faces), 3)]
    uv = [rng.dirichlet([1, 1, 1], len(one))[:, 1:] for one in faces]
    blend = blend_of_pixels(faces, uv, surface.faces, corners, weights, len(surface.vertices))
    assert blend.shape == (9, len(surface.vertices))
    of_faces, (u, v) = surface.vertices[surface.faces[np.concatenate(faces)]], np.concatenate(uv).T
    expected = (
        (1 - u - v)[:, None] * of_faces[:, 0] + u[:, None] * of_faces[:, 1] + v[:, None] * of_faces[:, 2]
    )
    assert np.allclose(blend @ surface.vertices, expected, atol=1e-6)


def test_a_proxy_is_small_and_its_blend_lies_on_the_surface():
    surface = bowl(0.5)
    assert proxy_of(surface, len(surface.vertices)) is surface
    proxy = proxy_of(surface, 300)
    assert 200 < len(proxy.vertices) < 450
    corners, weights = blend_of(
        surface, vertex_normals(surface.vertices, surface.faces), proxy, ProxySettings()
    )
    there = np.einsum("vc,vck->vk", weights, proxy.vertices[corners])
    assert np.abs(there - surface.vertices).max() < 0.06
    assert np.allclose(weights.sum(axis=1), 1, atol=1e-6) and weights.min() >= 0


def test_vertices_that_lie_on_one_another_are_one_before_they_are_decimated():
    """A mesh of loose triangles, as STL has it."""
    whole = bowl(0.5)
    loose = Surface(
        whole.vertices[whole.faces.ravel()], np.arange(whole.faces.size, dtype=np.int32).reshape(-1, 3)
    )
    assert len(proxy_of(loose, 10**6).vertices) == len(whole.vertices)
    assert len(proxy_of(loose, 300).vertices) < 450


def test_the_two_sides_of_a_thin_sheet_are_not_taken_for_one_another():
    """Two bowls, one within the other, closer than the proxy follows them."""
    inner, rng = bowl(0.5), np.random.default_rng(3)
    count = len(inner.vertices)
    inner = Surface(inner.vertices + rng.normal(0, 0.002, (count, 3)), inner.faces)
    both = Surface(
        np.concatenate([inner.vertices, 1.004 * inner.vertices]),
        np.concatenate([inner.faces, inner.faces[:, ::-1] + count]),
    )
    normals, proxy = vertex_normals(both.vertices, both.faces), proxy_of(both, 800)
    corners, weights = blend_of(both, normals, proxy, ProxySettings())
    there = np.einsum("vc,vck->vk", weights, vertex_normals(proxy.vertices, proxy.faces)[corners])
    opposed = np.einsum("vk,vk->v", there, normals) < 0
    assert opposed.mean() < 0.02


def test_without_occlusion_the_basis_is_eq_1s():
    """Eq. 1: transfer vectors of points that see the whole sky are ν."""
    normals = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    nothing = Occlusion(
        np.zeros((1, 9), np.float32), *(sp.csr_array((1, 1), dtype=np.float32) for _ in range(2))
    )
    blend = sp.csr_array(np.ones((2, 1), np.float32))
    open_sky, _ = PixelTransfer.of(normals, blend, Proxy(normals[:1], normals[:1], nothing), degree=2)
    assert np.allclose(open_sky.direct(), shading_basis(normals), atol=1e-7)


def test_pixels_that_see_the_back_of_the_mesh_count_as_open_to_the_sky():
    normals, blend = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]), sp.csr_array(np.ones((2, 1), np.float32))
    seen = Occlusion(np.full((1, 9), 0.1, np.float32), *(sp.csr_array((1, 1), dtype=np.float32),) * 2)
    proxy = Proxy(np.zeros((1, 3)), np.array([[0.0, 0.6, 0.8]]), seen)
    transfer, opposed = PixelTransfer.of(normals, blend, proxy, degree=2)
    assert opposed == 1
    assert np.allclose(transfer.direct()[0], shading_basis(normals[0]) - 0.1, atol=1e-6)
    assert np.allclose(transfer.direct()[1], shading_basis(normals[1]), atol=1e-6)
