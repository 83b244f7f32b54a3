"""The bust, its paint and its pictures: a truth that is itself tested."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import minimum_filter

from stages.formats.meshes.triangle_meshes import Surface
from stages.scene.cameras import Camera, pixel_centres, project
from stages.synthetic.lights import Dome, Lamp, Light, dome_radiance
from stages.synthetic.paints.paint import TABLE_1, paint_by_part, paint_for_matching
from stages.synthetic.paints.solid_noise import nearest_cell, smooth_noise
from stages.synthetic.render import Quality, Scene
from stages.synthetic.sample import exposure, halved, rounded, sample_cameras
from stages.synthetic.sensor_noise import with_sensor_noise
from stages.synthetic.subjects.bust import PARTS, build_bust, solid_distance
from stages.synthetic.subjects.isosurface import closed_surface
from stages.synthetic.truth import PaintedSurface
from stages.synthetic.views import arc_of_views

DIRECT = Quality(samples=49, reflections=1)
LAMP = Lamp(centre=(-2.0, -2.5, 2.5), towards=(0.0, 0.0, 0.5), side=1.0, radiance=(30.0, 20.0, 10.0))


@pytest.fixture(scope="module")
def bust():
    return build_bust(0.012)


@pytest.fixture(scope="module")
def ball() -> Surface:
    return closed_surface(
        lambda x: np.linalg.norm(x, axis=-1) - np.float32(0.5), np.full(3, -0.61), np.full(3, 0.61), 0.04
    )


def front_view(width: int = 60, height: int = 80, focal_px: float = 208.0) -> Camera:
    return arc_of_views([15.0], [10.0], 3.0, np.array([0.0, 0.0, 0.45]), (width, height), focal_px)[0]


def test_the_bust_is_closed_oriented_outwards_and_in_one_piece(bust):
    faces = bust.surface.faces.astype(np.int64)
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    count = len(bust.surface.vertices)
    forth, back = directed @ [count, 1], directed @ [1, count]
    assert len(np.unique(forth)) == len(forth)
    np.testing.assert_array_equal(np.sort(forth), np.sort(back))
    corners = bust.surface.vertices[faces]
    volume = np.einsum("fk,fk->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volume == pytest.approx(0.0797, rel=0.01)
    assert len(np.unique(faces)) == count


def test_the_bust_is_the_same_every_time(bust):
    again = build_bust(0.012)
    assert again.surface.vertices.tobytes() == bust.surface.vertices.tobytes()
    assert again.surface.faces.tobytes() == bust.surface.faces.tobytes()
    assert again.parts.tobytes() == bust.parts.tobytes()


def test_every_part_shows_and_sits_where_it_should(bust):
    share = np.bincount(bust.parts, minlength=len(PARTS)) / len(bust.parts)
    assert (share > 0.05).all()
    height = [np.median(bust.surface.vertices[bust.parts == part, 2]) for part in range(len(PARTS))]
    assert height[0] > height[1] > height[2] > height[3]


def test_the_surface_lies_on_the_zero_level(bust):
    assert np.quantile(np.abs(solid_distance(bust.surface.vertices.astype(np.float32))), 0.95) < 0.002


def test_the_mouth_is_a_cavity_open_to_the_front_only():
    inside = np.array([[0.0, -0.10, 0.665]], np.float32)
    assert solid_distance(inside) > 0.01
    to_front = inside + np.linspace(0, 0.3, 50, dtype=np.float32)[:, None] * np.array([0, -1, 0], np.float32)
    assert (solid_distance(to_front) > 0).all()
    for direction in ([1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1], [0, 1, 0]):
        steps = np.linspace(0, 0.12, 60, dtype=np.float32)[:, None] * np.array(direction, np.float32)
        assert (solid_distance(inside + steps) < 0).any(), f"the mouth has no wall towards {direction}"


def test_uniform_paint_is_table_1(bust):
    albedo = paint_by_part(bust.parts)
    np.testing.assert_allclose(
        albedo[bust.parts == 1], np.broadcast_to([1, 0.5333, 0.3608], (sum(bust.parts == 1), 3))
    )
    assert TABLE_1[PARTS.index("plinth")].tolist() == [0.1216] * 3


def test_paint_belongs_to_the_point_and_is_an_albedo(bust):
    x = bust.surface.vertices[::7]
    albedo = paint_for_matching(x, bust.parts[::7], finest=0.005)
    assert albedo.min() >= 0.02
    assert albedo.max() <= 0.9
    order = np.random.default_rng(0).permutation(len(x))
    np.testing.assert_array_equal(paint_for_matching(x[order], bust.parts[::7][order], 0.005), albedo[order])
    for part in range(len(PARTS)):
        assert albedo[bust.parts[::7] == part].mean(axis=1).std() > 0.08, (
            f"{PARTS[part]} has too little contrast"
        )


def test_solid_noise_is_continuous_and_its_cells_contain_their_points():
    x = np.random.default_rng(1).uniform(-1, 1, (2000, 3))
    near = x + 1e-6
    assert np.abs(smooth_noise(x, 0.1, 3) - smooth_noise(near, 0.1, 3)).max() < 1e-4
    assert 0.2 < smooth_noise(x, 0.1, 3).std() / np.sqrt(1 / 12) < 1
    distance, value = nearest_cell(x, 0.1, 3)
    assert distance.max() < np.sqrt(3)
    assert 0.45 < value.mean() < 0.55


def test_mitsuba_sees_a_square_where_the_camera_projects_it():
    """Eq. 7: off-centre principal point, oblique pose; the black square's centroid and area, in pixels."""
    camera = replace(front_view(), intrinsics=np.array([[208.0, 0, 23.3], [0, 208.0, 51.9], [0, 0, 1]]))
    right, down = camera.rotation[:2]
    middle, half = np.array([0.05, 0.0, 0.40]), 0.15
    corners = [middle + half * (a * right + b * down) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    square = Surface(np.array(corners), np.array([[0, 2, 1], [0, 3, 2]], np.int32))
    scene = Scene(square, np.zeros((4, 3)), Light())
    covered = 1 - scene.photograph(camera, Quality(samples=128, reflections=1), seed=0)[..., 0]
    xy, depth = project(camera, middle)
    assert covered.sum() == pytest.approx((2 * half * 208.0 / depth) ** 2, rel=1e-3)
    centroid = (covered[..., None] * pixel_centres(60, 80)).sum(axis=(0, 1)) / covered.sum()
    np.testing.assert_allclose(centroid, xy, atol=0.01)


def test_a_vertex_is_seen_at_its_depth_where_it_projects(bust):
    camera = front_view(600, 800, 2080.0)
    truth = PaintedSurface(bust.surface, paint_by_part(bust.parts)).truth(camera, samples_per_side=1)
    xy, depth = project(camera, bust.surface.vertices)
    within = ((xy > 0) & (xy < [600, 800])).all(axis=-1)
    column, row = np.floor(xy[within]).astype(int).T
    visible = np.abs(truth.depth[row, column] - depth[within]) < 0.002
    assert 0.3 < visible.mean() < 0.7
    normals = truth.normals[truth.mask]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1, atol=1e-5)


def test_without_bounces_the_image_is_albedo_times_shading(bust):
    """Eq. 1's premise I = ρ S: the render equals the true albedo times the render of the white bust."""
    camera, light = front_view(), Light(Dome((0.5, 0.7, 1.0), (0.2, 0.2, 0.2)), (LAMP,))
    albedo = paint_by_part(bust.parts)
    truth = PaintedSurface(bust.surface, albedo).truth(camera, samples_per_side=12)
    image = Scene(bust.surface, albedo, light).photograph(camera, DIRECT, seed=3)
    white = Scene(bust.surface, np.ones_like(albedo), light).photograph(camera, DIRECT, seed=3)
    # Pixels where parts meet hold a sum of products, not the product of the means.
    uniform = truth.mask & (np.abs(truth.albedo[..., None, :] - TABLE_1).max(axis=-1).min(axis=-1) < 1e-5)
    uniform = minimum_filter(uniform, 3)
    assert uniform.sum() > 0.6 * truth.mask.sum()
    np.testing.assert_allclose(image[uniform], (truth.albedo * white)[uniform], rtol=1e-4, atol=1e-6)


def test_under_an_even_dome_a_ball_without_bounces_shows_its_albedo(ball):
    camera = arc_of_views([30.0], [20.0], 3.0, np.zeros(3), (24, 24), 60.0)[0]
    albedo = np.full((len(ball.vertices), 3), (0.2, 0.5, 0.9))
    light = Light(Dome((2.0, 2.0, 2.0), (2.0, 2.0, 2.0)))
    image = Scene(ball, albedo, light).photograph(camera, DIRECT, seed=0)
    mask = PaintedSurface(ball, albedo).truth(camera).mask
    np.testing.assert_allclose(image[mask].mean(axis=0), [0.4, 1.0, 1.8], rtol=0.01)
    np.testing.assert_allclose(image[0, 0], 2.0, rtol=1e-5)


def test_bounces_brighten_the_mouth_and_the_same_seed_gives_the_same_bits(bust):
    camera = arc_of_views([0.0], [0.0], 1.0, np.array([0.0, 0.0, 0.65]), (16, 16), 200.0)[0]
    scene = Scene(bust.surface, np.full((len(bust.parts), 3), 0.8), Light())
    direct, bounced, again = (
        scene.photograph(camera, Quality(7, reflections), seed=5) for reflections in (1, 5, 5)
    )
    np.testing.assert_array_equal(bounced, again)
    assert bounced.mean() > 1.2 * direct.mean()


def test_light_adds_up(bust):
    camera, albedo = front_view(15, 20, 52.0), np.full((len(bust.parts), 3), 0.5)
    dome = Dome((1.0, 1.0, 1.0), (0.1, 0.1, 0.1))
    both, sky, lamp = (
        Scene(bust.surface, albedo, light).photograph(camera, DIRECT, seed=1)
        for light in (Light(dome, (LAMP,)), Light(dome), Light(None, (LAMP,)))
    )
    np.testing.assert_allclose(both, sky + lamp, rtol=1e-5)


def test_the_dome_is_sky_above_and_ground_below():
    dome = Dome((1.0, 2.0, 3.0), (0.1, 0.2, 0.3))
    np.testing.assert_allclose(
        dome_radiance(dome, np.deg2rad([90, 20, -20])), [dome.sky, dome.sky, dome.ground]
    )
    camera = arc_of_views([70.0], [-60.0], 3.0, np.zeros(3), (8, 8), 40.0)[0]  # from below, looking up
    far = Surface(np.array([[0, 0, -99.0], [1, 0, -99], [0, 1, -99]]), np.array([[0, 1, 2]], np.int32))
    image = Scene(far, np.zeros((3, 3)), Light(dome)).photograph(camera, DIRECT, seed=0)
    np.testing.assert_allclose(image, np.broadcast_to(dome.sky, image.shape), rtol=1e-4)


def test_mitsuba_is_not_asked_for_oblong_pixels(bust):
    camera = replace(front_view(), intrinsics=np.diag([208.0, 200.0, 1.0]))
    with pytest.raises(ValueError, match="square pixels"):
        Scene(bust.surface, paint_by_part(bust.parts), Light()).photograph(camera, DIRECT, seed=0)


def test_sensor_noise_is_a_knob_of_its_own():
    flat = np.full((200, 200), 0.25, np.float32)
    np.testing.assert_array_equal(with_sensor_noise(flat, 0, 0, seed=1), flat)
    noise = with_sensor_noise(flat, read=0.03, shot=0.08, seed=1) - flat
    assert noise.std() == pytest.approx(0.05, rel=0.02)  # √(0.03² + 0.08² · 0.25)
    np.testing.assert_array_equal(with_sensor_noise(flat, 0.03, 0.08, seed=1) - flat, noise)


def test_exposure_lets_one_pixel_in_a_thousand_saturate():
    image = np.linspace(0, 2, 3000, dtype=np.float32).reshape(60, 50, 1).repeat(3, axis=2)
    scale = exposure([image], [np.ones((60, 50), bool)])
    assert 1 <= (image[..., 0] * scale >= 1).sum() <= 3


def test_half_the_picture_is_what_half_the_camera_sees():
    camera = sample_cameras()[0]
    smaller = camera.scaled(camera.width // 2, camera.height // 2)
    small_pixels = pixel_centres(smaller.width, smaller.height)
    np.testing.assert_allclose(halved(pixel_centres(camera.width, camera.height)), 2 * small_pixels)


def test_rounding_keeps_eight_significant_bits():
    values = np.random.default_rng(0).uniform(0, 1, 1000).astype(np.float32)
    assert np.abs(rounded(values) / values - 1).max() <= 2**-8
    np.testing.assert_array_equal(rounded(values).astype(np.float16), rounded(values))
    np.testing.assert_array_equal(rounded(np.zeros(3)), 0)
