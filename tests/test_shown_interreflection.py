"""Interreflection as photos show it: what a bowl of known albedo bounces, and the unit light has by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from stages.geometry.occluders import Occluders
from stages.geometry.rays import vertex_normals
from stages.photometry.further_views.seen_vertices import SeenVertices, shown_by_all
from stages.photometry.light_search.search import Search
from stages.photometry.light_search.settings import LightSearchSettings, ReflectanceSettings
from stages.photometry.transport.directional_transport import even_directions
from stages.photometry.transport.lit_scenes import LitScene
from stages.photometry.transport.shown_radiance import ShownRadiance
from stages.photometry.transport.transfer_vectors import Occlusion, Proxy, occlusion
from tests.bowls import bowl
from tests.sphere_scene import sphere_scene

DEPTH, FORM_FACTORS, OFF = 0.6, 256, 1e-3
INNER = slice(0, -120)  # but for the rim, where facets and the offset weigh
DIRECTIONS = 128
BRIGHT = 0.98


@pytest.fixture(scope="module")
def open_bowl() -> Proxy:
    surface = bowl(DEPTH)
    normals = vertex_normals(surface.vertices, surface.faces).astype(float)
    caster = Occluders(surface, threads=2)
    lifted = surface.vertices - caster.origin + OFF * normals
    seen = occlusion(lifted, normals, caster.cast, len(lifted), 2, FORM_FACTORS)
    return Proxy(surface.vertices, normals.astype(np.float32), seen)


def by_a_sky_of_one(proxy: Proxy, albedo: float, shown: np.ndarray) -> np.ndarray:
    """What bounces at the vertices, (P,), where some of them show the radiance of a bowl of this albedo."""
    radiance = albedo * (1 - DEPTH) / (1 - albedo * DEPTH)
    half = shown[: len(shown) // 2], shown[len(shown) // 2 :]  # by two views
    seen = [SeenVertices(own, np.full((len(own), 3), 5 * radiance), np.full(len(own), 5.0)) for own in half]
    return shown_by_all(proxy, seen).interreflection(proxy)[:, 1]


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.8])
def test_a_bowl_of_known_albedo_bounces_what_a_sphere_does(open_bowl, albedo):
    """(1 − f)/(1 − ρ f) in all, 1 − f of it from the sky."""
    bounced = by_a_sky_of_one(open_bowl, albedo, np.arange(len(open_bowl.positions)))[INNER]
    expected = (1 - DEPTH) / (1 - albedo * DEPTH) - (1 - DEPTH)
    assert np.median(bounced) == pytest.approx(expected, rel=0.05)


def test_vertices_that_no_view_shows_send_what_their_neighbours_do_under_the_same_light(open_bowl):
    every = np.arange(len(open_bowl.positions))
    some = by_a_sky_of_one(open_bowl, 0.6, every[::7])[INNER]
    assert np.median(some) == pytest.approx(
        np.median(by_a_sky_of_one(open_bowl, 0.6, every)[INNER]), rel=0.02
    )


@pytest.mark.parametrize("sky_seen", [1.0, 0.5, 0.0])
def test_surface_that_no_view_shows_has_the_albedo_of_its_neighbour_not_its_light(sky_seen):
    """Vertex 0 sees nothing but vertex 2, unshown, which sees a part of the sky that vertex 1 does."""
    takes = sp.csr_array(([np.float32(1)], ([0], [2])), shape=(3, 3))
    normals = np.tile(np.array([[0.0, 0, 1]], np.float32), (3, 1))
    proxy = Proxy(
        np.array([[9.0, 0, 0], [0, 0, 0], [1, 0, 0]]), normals, Occlusion(np.zeros((3, 9)), takes, 0 * takes)
    )
    seen = np.ones((3, DIRECTIONS), bool)
    seen[2] = np.arange(DIRECTIONS) % 2 < 2 * sky_seen  # all, every other, none
    own = sp.csr_array(np.eye(3, dtype=np.float32))
    scene = LitScene.of(normals, own, proxy, np.packbits(seen, axis=1), DIRECTIONS, None)
    radiance = np.array([[0.0], [0.4], [0.0]]) * np.ones(3)
    shown = ShownRadiance.of(proxy, radiance, np.array([1.0, 1, 0]))
    even, before = np.ones((DIRECTIONS, 3)), np.zeros((3, 3), np.float32)
    bounced = shown.interreflection_under(proxy, scene.vertices, even, before)
    assert bounced[0] == pytest.approx(0.4 * sky_seen, rel=0.05)
    assert shown.interreflection(proxy)[0] == pytest.approx(0.4)


def test_black_surface_bounces_nothing(open_bowl):
    assert np.abs(by_a_sky_of_one(open_bowl, 0.0, np.arange(len(open_bowl.positions)))).max() < 1e-6


def beside_a_wall(brightest: float, tint: np.ndarray) -> tuple[LitScene, np.ndarray, np.ndarray]:
    """A painted sphere under a bright sky, every other band of it lit by a wall, too; its photo and albedo.

    The bands see half of what the wall shows, which is seen alone and has a tint.
    """
    sphere = sphere_scene(view_count=3)
    normals = np.concatenate([n[m] for n, m in zip(sphere.normals, sphere.masks, strict=True)])
    albedo = np.stack(sphere.true_channels(), axis=1)
    albedo *= brightest / np.quantile(albedo, BRIGHT)
    of_vertex = (np.sin(9 * normals[:, 1] + 5 * normals[:, 0]) > 0).astype(int)  # 0 in the open, 1 beside
    wall = np.abs(normals[:, 2]) > 0.97
    of_vertex[wall], albedo[wall] = 2, brightest * tint
    blend = sp.csr_array(np.eye(3, dtype=np.float32)[of_vertex])
    takes = sp.csr_array(([np.float32(0.5)], ([1], [2])), shape=(3, 3))
    apart = np.arange(3)[:, None] * [10.0, 0, 0]
    proxy = Proxy(
        apart,
        np.tile(np.array([[0.0, 0, 1]], np.float32), (3, 1)),
        Occlusion(np.zeros((3, 9)), takes, 0 * takes),
    )
    seen = np.full((3, DIRECTIONS // 8), 255, np.uint8)
    scene = LitScene.of(normals.astype(np.float32), blend, proxy, seen, DIRECTIONS, None)
    sky = 0.3 + 2.5 * np.maximum(even_directions(DIRECTIONS) @ [0.4, 0.5, 0.77], 0) ** 6
    shading = scene.pixels.shading(np.tile(sky[:, None], 3).astype(np.float32))
    shown = (albedo * shading)[wall].mean(axis=0)
    shading[of_vertex == 1] += 0.5 * shown
    image = (albedo * shading).astype(np.float32)
    shown = ShownRadiance.of(proxy, blend.T @ image, blend.T @ np.ones(len(image)))
    return replace(scene, shown=shown), image, albedo


@pytest.mark.parametrize("tint", [(1.0, 1.0, 1.0), (1.0, 0.5, 0.2)], ids=["white", "red"])
@pytest.mark.parametrize("brightest", [0.3, 0.7])
def test_light_has_the_unit_in_which_surfaces_send_each_other_what_they_show(brightest, tint):
    """Wherever the search begins: pairs in the open and beside the wall agree in that unit alone."""
    scene, image, albedo = beside_a_wall(brightest, np.array(tint))
    views, found = sphere_scene(view_count=3).stacked(), []
    for usual in (0.3, 0.8):
        how = LightSearchSettings(samples=3000, reflectance=ReflectanceSettings(usual=usual))
        one_light = np.zeros(views.view_count, np.int64)
        search = Search.of(scene, views, image, np.ones(len(image), bool), one_light, how)
        light = search.light(lambda: None)
        ratio = np.median(image / light.shading(scene, views.starts, one_light) / albedo, axis=0)
        found.append(ratio)
    assert np.array(found) == pytest.approx(np.ones((2, 3)), abs=0.1)


def test_a_given_reflectance_sets_the_unit():
    scene, image, _ = beside_a_wall(0.5, np.ones(3))
    views = sphere_scene(view_count=3).stacked()
    for given in (0.25, 0.9):
        how = LightSearchSettings(samples=3000, brightest=given)
        one_light = np.zeros(views.view_count, np.int64)
        search = Search.of(scene, views, image, np.ones(len(image), bool), one_light, how)
        assert search.brightest(search.even_light()) == pytest.approx(given, rel=0.2)
        assert search.brightest(search.light(lambda: None)) == pytest.approx(given, rel=0.2)
