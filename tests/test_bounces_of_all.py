"""Interreflection of surface that the light was not estimated from: as the albedo there demands."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from stages.geometry.occluders import Occluders
from stages.geometry.rays import vertex_normals
from stages.photometry.further_views.bounces_of_all import SeenVertices, bounced_of_all
from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.transport.directional_transport import even_directions
from stages.photometry.transport.lit_scenes import LitScene
from stages.photometry.transport.settings import VisibilitySettings
from stages.photometry.transport.sky_visibility import visible_directions
from stages.photometry.transport.transfer_vectors import Proxy, occlusion
from tests.bowls import bowl

DEPTH, SKY, FORM_FACTORS, OFF = 0.6, 256, 256, 1e-3
INNER = slice(0, -120)  # but for the rim, where facets and the offset weigh


@pytest.fixture(scope="module")
def bowl_in_the_open() -> LitScene:
    """A bowl under all directions, shown by no pixel."""
    surface = bowl(DEPTH)
    normals = vertex_normals(surface.vertices, surface.faces).astype(float)
    caster = Occluders(surface, threads=2)
    lifted = surface.vertices - caster.origin + OFF * normals
    seen = occlusion(lifted, normals, caster.cast, len(lifted), 2, FORM_FACTORS)
    visible = visible_directions(lifted, normals, caster.blocked, even_directions(SKY), VisibilitySettings())
    proxy = Proxy(surface.vertices, normals.astype(np.float32), seen)
    nothing = sp.csr_array((0, len(lifted)), dtype=np.float32)
    return LitScene.of(np.zeros((0, 3)), nothing, proxy, visible, SKY, None)


def by_a_sky_of_one(scene: LitScene, albedo: float, shown: np.ndarray) -> np.ndarray:
    """What bounces at the vertices, (P,), where some of them show the radiance of a bowl of this albedo."""
    radiance = albedo * (1 - DEPTH) / (1 - albedo * DEPTH)
    half = shown[: len(shown) // 2], shown[len(shown) // 2 :]  # by two views
    seen = [SeenVertices(own, np.full((len(own), 3), 5 * radiance), np.full(len(own), 5.0)) for own in half]
    vertices = len(scene.vertices.normals)
    wrong = LightEstimate(np.ones((1, SKY, 3)), np.full((1, vertices, 3), 0.3, np.float32))
    found = bounced_of_all(scene, wrong, seen)
    assert found.radiance is wrong.radiance
    return found.bounced[0, :, 1]


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.8])
def test_a_bowl_of_known_albedo_bounces_what_a_sphere_does(bowl_in_the_open, albedo):
    """(1 − f)/(1 − ρ f) in all, 1 − f of it from the sky."""
    every = np.arange(len(bowl_in_the_open.vertices.normals))
    bounced = by_a_sky_of_one(bowl_in_the_open, albedo, every)[INNER]
    expected = (1 - DEPTH) / (1 - albedo * DEPTH) - (1 - DEPTH)
    assert np.median(bounced) == pytest.approx(expected, rel=0.05)


def test_vertices_that_no_view_shows_have_the_albedo_of_their_neighbours(bowl_in_the_open):
    every = np.arange(len(bowl_in_the_open.vertices.normals))
    some = by_a_sky_of_one(bowl_in_the_open, 0.6, every[::7])[INNER]
    assert np.median(some) == pytest.approx(
        np.median(by_a_sky_of_one(bowl_in_the_open, 0.6, every)[INNER]), rel=0.02
    )


def test_black_surface_bounces_nothing(bowl_in_the_open):
    every = np.arange(len(bowl_in_the_open.vertices.normals))
    assert np.abs(by_a_sky_of_one(bowl_in_the_open, 0.0, every)).max() < 1e-6
