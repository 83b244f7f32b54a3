"""Bright cells of the light, divided: the same light, and then a sharper one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from stages.photometry.light_search.direction_refinement import bright_cells, divided
from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.search import estimate_light
from stages.photometry.light_search.settings import RefinementSettings
from stages.photometry.lighting.estimate_illumination import find_illumination
from stages.photometry.transport.directional_transport import (
    AROUND,
    Sphere,
    even_directions,
    honeycomb,
)
from stages.photometry.transport.environment import picture_of_light
from stages.photometry.transport.light_priors import contrast
from stages.photometry.transport.lit_scenes import LitScene
from stages.photometry.transport.settings import LightPictureSettings, VisibilitySettings
from stages.photometry.transport.sky_visibility import VisibilityProbes
from stages.photometry.transport.transfer_vectors import Occlusion, Proxy
from tests.by_sky import decompose_by_sky
from tests.sphere_scene import sphere_scene
from tests.test_sky_light import DIRECTIONS, FEW, HOW, error, normals_of, photo_of, viewing

COUNT = 64
FINER = RefinementSettings()
ORIGIN = np.array([10.0, -5, 3])  # that rays are relative to
SUN = np.array([0.6, 0.0, 0.8])


def behind_a_wall(x: float):
    """Rays are blocked that go far to the left of a point: beyond ``x`` of their directions."""
    return lambda origins, directions: directions[:, 0] < x


def scene_of(blocked, sphere: Sphere | None = None) -> LitScene:
    """Three vertices that face up and aside, shown by a pixel each."""
    normals = np.array([[0.0, 0, 1], [0.6, 0, 0.8], [0, 1, 0]])
    probes = VisibilityProbes(
        -ORIGIN + np.zeros((3, 3), np.float32), normals, blocked, ORIGIN, VisibilitySettings()
    )
    none = sp.csr_array((3, 3), dtype=np.float32)
    proxy = Proxy(np.zeros((3, 3)), normals.astype(np.float32), Occlusion(np.zeros((3, 9)), none, none))
    own = sp.csr_array(np.eye(3, dtype=np.float32))
    seen = probes.see(even_directions(COUNT), sphere)
    return replace(LitScene.of(normals, own, proxy, seen, COUNT, sphere), probes=probes)


def sunny(peak: float = 20.0) -> LightEstimate:
    light = 0.5 + peak * np.maximum(even_directions(COUNT) @ SUN, 0) ** 60
    return LightEstimate(np.tile(light[None, :, None], (1, 1, 3)), np.zeros((1, 3, 3), np.float32))


def test_the_light_is_the_same_and_its_cells_still_hold_all_directions():
    scene, light = scene_of(behind_a_wall(-2)), sunny()
    finer, same = divided(scene, light, FINER)
    bright = bright_cells(light.radiance, scene.pixels.cells, FINER)
    assert 0 < bright.size < FINER.max_cells
    assert len(finer.pixels.directions) == COUNT + AROUND * bright.size == same.radiance.shape[1]
    for transport in (finer.pixels, finer.vertices):
        assert transport.cells.sum() == pytest.approx(1)
        assert np.allclose(np.linalg.norm(transport.directions, axis=1), 1, atol=1e-6)
    before, after = scene.pixels.shading(light.radiance[0]), finer.pixels.shading(same.radiance[0])
    assert np.allclose(before, after, rtol=0.05)  # cells of 30° end where surface turns away
    prices = [
        contrast(*each)[0]
        for each in ((light.radiance, scene.pixels.cells), (same.radiance, finer.pixels.cells))
    ]
    assert prices[0] == pytest.approx(prices[1])


def test_new_directions_lie_around_the_old_as_far_away_as_their_cells_are_wide():
    directions, cells = even_directions(COUNT)[[3, 40]], np.full(2, 1 / COUNT / 7)
    around = honeycomb(directions, cells).reshape(2, AROUND, 3)
    away = np.arccos(np.einsum("nk,nak->na", directions, around))
    assert away == pytest.approx(np.sqrt(2 / np.sqrt(3) * 4 * np.pi / COUNT / 7), rel=1e-3)
    apart = np.linalg.norm(around - np.roll(around, 1, axis=1), axis=2)
    assert apart == pytest.approx(away, rel=0.02)


def test_each_new_direction_is_looked_in():
    """A wall's edge between an old direction and those around it hides some of these only."""
    bright = bright_cells(sunny().radiance, np.full(COUNT, 1 / COUNT), FINER)
    edge = float(even_directions(COUNT)[bright, 0].mean())
    finer, _ = divided(scene_of(behind_a_wall(edge)), sunny(), FINER)
    seen = np.unpackbits(finer.pixels.visible, axis=1, count=len(finer.pixels.directions))
    facing = finer.pixels.directions @ finer.pixels.normals.T > 0.05
    assert np.array_equal(seen.T[facing] == 1, np.tile(finer.pixels.directions[:, :1] >= edge, 3)[facing])
    new = seen[0, COUNT:]
    assert 0 < new.sum() < new.size


def test_a_lamp_at_hand_is_looked_at_where_it_is():
    """From off the centre, a lamp on a sphere lies elsewhere than from its middle."""
    asked = []

    def blocked(origins, directions):
        asked.append(directions)
        return np.zeros(len(directions), bool)

    scene = scene_of(blocked, Sphere((0.5, 0, 0), 2.0))
    asked.clear()
    finer, _ = divided(scene, sunny(), FINER)
    towards = finer.pixels.directions[COUNT] + np.array([0.25, 0, 0])
    assert np.allclose(asked[0][0], towards / np.linalg.norm(towards), atol=1e-6)


def test_nothing_is_divided_where_nothing_is_bright_or_nobody_looks():
    scene, even = scene_of(behind_a_wall(-2)), sunny(0.0)
    assert divided(scene, even, FINER) == (scene, even)
    blind = replace(scene, probes=None)
    assert divided(blind, sunny(), FINER)[0] is blind


def test_only_so_many_cells_are_divided_and_those_that_send_most():
    cells = np.full(1000, 1e-3)
    light = np.ones((1, 1000, 3))
    light[0, :100] = np.arange(1000, 1100)[:, None]
    assert bright_cells(light, cells, FINER).tolist() == list(range(100 - FINER.max_cells, 100))
    cells[99] = 1e-6
    assert 99 not in bright_cells(light, cells, FINER)


def test_of_many_lights_each_is_measured_by_itself():
    """Thirty, one a thousand times as bright as the others, every one with its sun elsewhere."""
    lights = np.ones((30, 1000, 3))
    lights[np.arange(30), 20 * np.arange(30)] = 50
    lights[7] *= 1000
    found = bright_cells(lights, np.full(1000, 1e-3), FINER)
    assert found.size == FINER.max_cells and np.all(found % 20 == 0)


def test_the_picture_holds_all_the_light_where_some_cells_are_finer():
    radiance, polar = sunny().radiance[0], np.pi * (np.arange(64) + 0.5) / 64
    finer, same = divided(scene_of(behind_a_wall(-2)), sunny(), FINER)
    middle = np.argmax(radiance.sum(axis=1))
    alone = np.where(np.arange(len(finer.pixels.cells)) == middle, 100.0, 0)[:, None]
    solid = np.repeat(np.sin(polar), 128)[:, None] / (128 * np.sin(polar).sum())
    for light, cells, directions in (
        (radiance, None, even_directions(COUNT)),
        (same.radiance[0], finer.pixels.cells, finer.pixels.directions),
        (alone, finer.pixels.cells, finer.pixels.directions),
    ):
        picture = picture_of_light(directions, light, LightPictureSettings(), cells).reshape(64 * 128, -1)
        held = light.mean(axis=0) if cells is None else cells @ light
        assert (solid * picture).sum(axis=0) == pytest.approx(held, rel=0.03)


def below_a_roof(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Rays meet a plane above all points, left of the middle."""
    up = np.maximum(directions[:, 2], 1e-6)
    return (origins[:, 0] + (3 - origins[:, 2]) / up * directions[:, 0] < 0) & (directions[:, 2] > 0)


def lit_under_a_roof(sun: np.ndarray, radius: float | None = None):
    """Views of a painted sphere under a sun and an even sky, and a roof that shades a part.

    Returns the views, the scene of light from infinity (and that of light from a sphere of this radius), the
    image and the shading.
    """
    shown = sphere_scene(view_count=3)
    views, normals, albedo = shown.stacked(), normals_of(shown), np.stack(shown.true_channels(), axis=1)
    probes, points = (
        VisibilityProbes(normals, normals, below_a_roof, np.zeros(3), VisibilitySettings()),
        len(normals),
    )
    own, none = sp.eye_array(points, dtype=np.float32, format="csr"), sp.csr_array((points, points))
    proxy = Proxy(normals, normals.astype(np.float32), Occlusion(np.zeros((points, 9)), none, none))
    spheres = [None] if radius is None else [None, Sphere((0.0, 0.0, 0.0), radius)]
    scenes = []
    for sphere in spheres:
        seen = probes.see(even_directions(DIRECTIONS), sphere)
        scene = LitScene.of(normals, own, proxy, seen, DIRECTIONS, sphere)
        scenes.append(replace(scene, probes=probes))
    free = ~below_a_roof(normals, np.tile(sun, (points, 1)))
    shading = 0.3 * scenes[0].pixels.shading(np.ones((DIRECTIONS, 3)))
    shading += 2 * (free * np.maximum(normals @ sun, 0))[:, None]
    return views, scenes, photo_of(albedo, shading), shading


@pytest.fixture(scope="module")
def under_a_roof():
    """Views of a painted sphere; a sun between three directions, and a roof that shades a part."""
    towards = even_directions(DIRECTIONS)[np.argsort(-even_directions(DIRECTIONS) @ [0.3, 0.4, 0.87])[:3]]
    sun = towards.sum(axis=0) / np.linalg.norm(towards.sum(axis=0))
    views, (sky,), image, shading = lit_under_a_roof(sun)
    return views, sky, image, shading


def test_the_shadow_of_a_sun_between_the_directions_is_found_where_it_is(under_a_roof):
    views, sky, image, shading = under_a_roof
    everything, one_light = np.ones(len(image), bool), np.zeros(3, int)
    coarse = estimate_light(sky, views, image, everything, one_light, FEW)
    finer, near = divided(sky, coarse, FINER)
    fine = estimate_light(finer, views, image, everything, one_light, FEW, near=near)
    left = [
        error(light.shading(scene, views.starts, one_light), shading)
        for scene, light in ((sky, coarse), (finer, fine))
    ]
    assert left[1] < 0.7 * left[0]


@pytest.mark.parametrize("specular", [False, True])
def test_the_decomposition_divides_what_it_may_look_in(under_a_roof, specular):
    views, sky, image, shading = under_a_roof
    channels, looked = list(image.T.copy()), viewing(np.ones(len(image), bool))
    how = HOW.with_light(lights="shared").with_specular(specular)
    fine, coarse = (
        decompose_by_sky(views, channels, [scene], looked, how).light
        for scene in (sky, replace(sky, probes=None))
    )
    assert len(coarse.directions) == len(coarse.cells) == DIRECTIONS
    assert len(fine.directions) == len(fine.cells) == fine.light.radiance.shape[1] > DIRECTIONS
    assert error(fine.light.shading, shading) < 0.7 * error(coarse.light.shading, shading)


def test_a_sun_between_the_directions_is_not_taken_for_a_lamp():
    """The shadows of a lamp resemble its own more than those of the cells around it do."""
    sun = np.array([0.09, -0.10, 0.99])
    views, scenes, image, _ = lit_under_a_roof(sun / np.linalg.norm(sun), radius=4.0)
    channels, looked = list(image.T.copy()), viewing(np.ones(len(image), bool))
    how = HOW.with_light(lights="shared").with_specular(False)
    cells_alone = [replace(scene, probes=None) for scene in scenes]
    fine, coarse = (
        find_illumination(views, channels, each, looked, how.light, 1, lambda: None)
        for each in (scenes, cells_alone)
    )
    assert coarse.scene == 1, "no test if the cells do not mislead"
    assert fine.scene == 0
