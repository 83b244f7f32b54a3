"""What a rendered scene is put together from: lights, subjects, frames, stripes, gloss, smoothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import open3d as o3d
import pytest

from pipeline import UserError
from stages.formats.meshes.triangle_meshes import Surface, read_vertex_colours, to_open3d, write_mesh
from stages.photometry.transport.environment import directions_of_picture
from stages.scene.cameras import project
from stages.synthetic.lights import (
    FOUR_LAMPS,
    ONE_LAMP,
    SKY_DOME,
    ClearSky,
    Dome,
    Environment,
    Light,
    Placed,
    clear_sky_picture,
    dome_picture,
    lamps_around,
)
from stages.synthetic.paints.paint import STRIPE, with_stripes
from stages.synthetic.render import Gloss, Quality, Scene
from stages.synthetic.subjects.bust import PARTS
from stages.synthetic.subjects.smoothing import laplacian_smoothing
from stages.synthetic.subjects.subject import bust_subject, mesh_subject
from stages.synthetic.truth import PaintedSurface
from stages.synthetic.views import arc_of_views, framed
from tests.rendered_scene import ball, towards_origin

DIRECT = Quality(samples=64, reflections=1)
UNSEEN = Quality(samples=1, reflections=1)


def patch(row: int, column: int) -> np.ndarray:
    """A black map of all directions, 18×36 pixels of 10°, but for one bright pixel."""
    radiance = np.zeros((18, 36, 3), np.float32)
    radiance[row, column] = 100.0
    return radiance


# The first row is straight up, the last straight down: row 4 of 18 lies at 90° − 4/17 · 180° = 47.6°.
# Columns are 10° wide: column 18 begins in the middle, column 27 a quarter of a turn to the right of it.
# Azimuth: 0 faces the figure (from −y), positive towards +x.
@pytest.mark.parametrize(
    ("row", "column", "turn_deg", "azimuth_deg", "elevation_deg"),
    [
        (8, 18, 0.0, -5, 5.3),  # the middle looks along −y; half a column right of it a little to −x
        (4, 27, 0.0, -95, 47.6),  # to the right lies −x
        (8, 8, 0.0, 95, 5.3),  # to the left +x
        (8, 18, 90.0, 85, 5.3),  # counter-clockwise from above: −y goes to +x
        (13, 18, -30.0, -35, -47.6),
    ],
)
def test_an_environment_lights_from_where_its_picture_is_bright(
    row, column, turn_deg, azimuth_deg, elevation_deg
):
    """Where a ball without bounces is lit, its shading is n · l: least squares gives l."""
    surface = ball()
    light = Light(Environment(patch(row, column), turn_deg))
    camera = towards_origin(azimuth_deg + 20, elevation_deg, 24, 60.0)
    image = Scene(surface, np.ones((len(surface.vertices), 3)), light).photograph(camera, DIRECT, seed=0)
    truth = PaintedSurface(surface, np.ones((len(surface.vertices), 3))).truth(camera)
    lit = truth.mask & (image[..., 0] > 0.3 * image[truth.mask].max())
    towards_light = np.linalg.lstsq(truth.normals[lit], image[lit][:, 0], rcond=None)[0]
    a, e = np.deg2rad([azimuth_deg, elevation_deg])
    expected = np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
    cosine = towards_light @ expected / np.linalg.norm(towards_light)
    assert np.rad2deg(np.arccos(cosine)) < 0.7


def test_an_environment_is_seen_in_the_background_where_it_shines_from():
    """A camera that looks along −y sees the middle of the map, what is right of it on the right, up is up."""
    far = Surface(np.array([[0, 0, -99.0], [1, 0, -99], [0, 1, -99]]), np.array([[0, 1, 2]], np.int32))
    ramp = np.zeros((36, 72, 3), np.float32)
    ramp[..., 0] = np.linspace(0, 1, 72)  # red grows to the right
    ramp[..., 1] = np.linspace(1, 0, 36)[:, None]  # green grows upwards
    camera = arc_of_views([180.0], [0.0], 3.0, np.zeros(3), (9, 9), 9.0)[0]  # from +y, towards −y
    image = Scene(far, np.zeros((3, 3)), Light(Environment(ramp))).photograph(camera, DIRECT, seed=0)
    np.testing.assert_allclose(image[4, 4, :2], 0.5, atol=0.02)
    assert (np.diff(image[4, :, 0]) > 0.005).all()
    assert (np.diff(image[:, 4, 1]) < -0.005).all()


def test_a_dome_as_a_picture_is_bright_above():
    picture = dome_picture(Dome((1.0, 2.0, 3.0), (0.1, 0.2, 0.3)), rows=20).radiance
    assert picture.shape == (20, 40, 3)
    np.testing.assert_allclose(picture[0], np.tile([1.0, 2.0, 3.0], (40, 1)), rtol=1e-6)
    np.testing.assert_allclose(picture[-1], np.tile([0.1, 0.2, 0.3], (40, 1)), rtol=1e-6)
    np.testing.assert_allclose(picture[9:11].mean(axis=0)[0], [0.55, 1.1, 1.65], rtol=1e-5)


def test_a_clear_sky_has_its_sun_where_and_as_strong_as_stated():
    sky = ClearSky(sun_azimuth_deg=-30.0, sun_elevation_deg=50.0, sun=(0.9, 0.8, 0.6))
    radiance = clear_sky_picture(sky, rows=256).radiance
    assert radiance.dtype == np.float32
    black = (0.0, 0.0, 0.0)
    alone = replace(sky, zenith=black, horizon=black, ground=black)
    sun = clear_sky_picture(alone, rows=256).radiance.astype(float)
    elevation = np.linspace(np.pi / 2, -np.pi / 2, 256)
    weight = np.cos(elevation)[:, None, None] * (np.pi / 256) ** 2
    np.testing.assert_allclose((sun * weight).sum(axis=(0, 1)) / np.pi, sky.sun, rtol=1e-4)
    towards = ((sun * weight)[..., :1] * directions_of_picture(256)).sum(axis=(0, 1))
    towards /= np.linalg.norm(towards)
    a, e = np.deg2rad([-30, 50])
    expected = np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
    assert np.rad2deg(np.arccos(towards @ expected)) < 0.5
    np.testing.assert_allclose(radiance[-1], np.tile(sky.ground, (512, 1)), rtol=1e-6)
    top = radiance[0, 0]
    assert top[2] > 1.5 * top[0]


def test_a_metal_reflects_in_its_own_colour_and_shows_no_albedo_of_its_own():
    """Under an even dome without bounces a smooth conductor shows its reflectance, nearly everywhere."""
    surface = ball(0.03)
    count = len(surface.vertices)
    copper = np.tile([0.8, 0.5, 0.3], (count, 1))
    gloss = Gloss(np.ones(count), np.full(count, 0.05), copper)
    even = Light(Dome((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)))
    camera = towards_origin(0.0, 0.0)
    image = Scene(surface, np.zeros((count, 3)), even, gloss).photograph(camera, DIRECT, seed=0)
    inside = PaintedSurface(surface, copper).truth(camera).mask
    np.testing.assert_allclose(np.median(image[inside], axis=0), [0.8, 0.5, 0.3], rtol=0.02)


def card(centre: np.ndarray, facing: np.ndarray, side: float) -> Surface:
    """A square that faces `facing`, a unit vector."""
    across = np.cross([0.0, 0.0, 1.0], facing)
    across /= np.linalg.norm(across)
    up = np.cross(facing, across)
    corners = [centre + side / 2 * (a * across + b * up) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return Surface(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]], np.int32))


@pytest.mark.parametrize("place", [*FOUR_LAMPS, *ONE_LAMP])
def test_a_white_card_that_faces_a_lamp_shows_the_shading_stated(place):
    centre, radius = np.array([0.3, -0.2, 0.5]), 0.7
    (lamp,) = lamps_around((place,), centre, radius)
    towards_lamp = (np.array(lamp.centre) - centre) / np.linalg.norm(np.array(lamp.centre) - centre)
    assert np.linalg.norm(np.array(lamp.centre) - centre) == pytest.approx(4 * radius)
    assert lamp.side == pytest.approx(place.side_radii * radius)
    white = card(centre, towards_lamp, side=0.02)
    scene = Scene(white, np.ones((4, 3)), Light(None, (lamp,)))
    around, above = place.azimuth_deg, place.elevation_deg
    (camera,) = arc_of_views([around + 30], [above], 1.0, centre, (8, 8), 1000.0)  # sees nothing but the card
    image = scene.photograph(camera, DIRECT, seed=0)
    np.testing.assert_allclose(image.mean(axis=(0, 1)), place.shading, rtol=0.005)
    (behind,) = arc_of_views([around], [above], radius, np.array(lamp.centre), (8, 8), 20.0)
    assert scene.photograph(behind, UNSEEN, seed=0).max() == 0  # it shines to one side only


def test_lamps_stand_where_the_angles_say():
    """Azimuth 0 faces the figure (from −y), positive towards its left (+x)."""
    front, left, above = lamps_around(
        (Placed(0, 0, 1, 1), Placed(90, 0, 1, 1), Placed(0, 90, 1, 1)), np.array([1.0, 2.0, 3.0]), 0.5
    )
    np.testing.assert_allclose(front.centre, [1, 0, 3], atol=1e-12)
    np.testing.assert_allclose(left.centre, [3, 2, 3], atol=1e-12)
    np.testing.assert_allclose(above.centre, [1, 2, 5], atol=1e-12)


@pytest.mark.parametrize("size", [(54, 96), (96, 54)])
def test_a_frame_holds_all_points_and_touches_them_once(size):
    points = np.random.default_rng(3).uniform(-1, 1, (500, 3)) * [0.3, 0.2, 0.5] + [5.0, 0, 1]
    cameras = framed(
        arc_of_views([-60.0, 0.0, 70.0], [5.0, 30.0, -10.0], 3.0, np.array([5.0, 0, 1]), size, 1.0),
        points,
        margin=0.1,
    )
    width, height = size
    (focal_px,) = {camera.intrinsics[0, 0] for camera in cameras}
    room = []
    for camera in cameras:
        xy, depth = project(camera, points)
        assert (depth > 0).all()
        assert camera.intrinsics[1, 1] == focal_px
        room += [xy / size - 0.1, 0.9 - xy / size]
    assert np.min(room) == pytest.approx(0, abs=1e-12)


def test_an_object_is_divided_into_parts_around_points_far_apart():
    points = np.random.default_rng(1).uniform(-1, 1, (400, 3))
    surface = Surface(points, np.arange(399, dtype=np.int32).reshape(-1, 3))
    subject = mesh_subject(surface, parts=7)
    assert subject.part_names == tuple(f"part{k}" for k in range(1, 8))
    assert set(subject.parts) == set(range(7))
    assert subject.parts[points[:, 2].argmax()] == 0
    np.testing.assert_array_equal(mesh_subject(surface, parts=7).parts, subject.parts)
    assert set(mesh_subject(surface, parts=1).parts) == {0}
    middles = np.array([points[subject.parts == part].mean(axis=0) for part in range(7)])
    nearest = np.linalg.norm(points[:, None] - middles, axis=-1).argmin(axis=1)
    assert (nearest == subject.parts).mean() > 0.7  # surroundings, not scattered vertices


def test_an_object_with_y_upwards_is_set_upright_and_faces_the_cameras():
    surface = Surface(np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0]]), np.array([[0, 1, 2]], np.int32))
    turned = mesh_subject(surface, parts=1, y_up=True).surface
    np.testing.assert_array_equal(turned.vertices, [[0, 0, 1], [0, -1, 0], [1, 0, 0]])  # up, front, left
    np.testing.assert_array_equal(turned.faces, surface.faces)
    np.testing.assert_array_equal(mesh_subject(surface, parts=1).surface.vertices, surface.vertices)


def test_centre_and_radius_are_those_of_the_bounding_box():
    subject = mesh_subject(Surface(np.array([[0, 0, 0], [2, 4, 4.0], [1, 1, 1]]), np.array([[0, 1, 2]])), 1)
    np.testing.assert_array_equal(subject.centre, [1, 2, 2])
    assert subject.radius == 3


def test_the_bust_for_experiments_has_its_four_parts_and_a_narrow_foot():
    subject = bust_subject(0.03)
    assert subject.part_names == PARTS
    assert set(subject.parts) == {0, 1, 2, 3}
    foot = subject.surface.vertices[subject.surface.vertices[:, 2] < -0.02]
    assert np.hypot(foot[:, 0], foot[:, 1]).max() == pytest.approx(0.19, abs=0.01)


def test_stripes_are_equally_wide_and_cover_only_what_is_striped():
    heights = np.linspace(-1, 1, 20001)[:-1]  # negative ones as well
    x = np.stack([np.zeros(20000), np.ones(20000), heights], axis=1)
    striped = np.arange(20000) % 3 > 0
    before = np.full((20000, 3), (0.0, 0.1, 0.9), np.float32)
    after = with_stripes(before, x, striped, period=0.1)
    np.testing.assert_array_equal(after[~striped], before[~striped])
    yellow = np.abs(after - STRIPE.astype(np.float32)).max(axis=1) == 0
    assert (yellow | (after == before).all(axis=1)).all()
    assert yellow[striped].mean() == pytest.approx(0.5, abs=0.001)
    changes = heights[striped][1:][np.diff(yellow[striped].astype(int)) != 0]
    np.testing.assert_allclose(np.diff(changes), 0.05, atol=3e-4)


def test_gloss_adds_a_highlight_and_takes_its_share_elsewhere():
    """Without bounces: (1 − share) of the matt picture outside the highlight, much more inside it."""
    surface, share = ball(0.03), 0.3
    count = len(surface.vertices)
    paint = np.full((count, 3), (0.8, 0.4, 0.1))
    lamp = Light(None, lamps_around((Placed(0, 30, 1, 1.0),), np.zeros(3), 0.5))
    camera = towards_origin(0.0, -10.0, 24, 60.0)
    diffuse = Scene(surface, paint, lamp).photograph(camera, DIRECT, seed=1)
    glossy = Scene(surface, paint, lamp, Gloss.white(np.full(count, share), 0.05)).photograph(
        camera, DIRECT, seed=2
    )
    truth = PaintedSurface(surface, paint).truth(camera)
    to_lamp = np.array([0, -np.cos(np.pi / 6), 0.5])
    half = to_lamp - camera.rotation[2]  # the mirror between lamp and camera
    from_mirror = np.rad2deg(np.arccos(truth.normals @ half / np.linalg.norm(half)))
    lit = truth.mask & (truth.normals @ to_lamp > 0.3)
    outside = lit & (from_mirror > 30)
    assert outside.sum() > 50
    excess = glossy - (1 - share) * diffuse
    np.testing.assert_allclose(excess[outside].mean(axis=0), 0, atol=0.002)  # the tail of GGX; 0.3 in red
    excess = excess[lit & (from_mirror < 5)]
    assert len(excess) > 3
    assert (excess > 0.5 * share).all()  # of the lamp's radiance, 51
    np.testing.assert_allclose(excess.mean(axis=0) / excess.mean(), 1, rtol=0.02)  # white, whatever the paint


def test_no_gloss_is_gloss_with_no_share():
    surface = ball()
    count = len(surface.vertices)
    paint, camera = np.full((count, 3), 0.5), towards_origin(0.0, 0.0)
    diffuse, glossy = (
        Scene(surface, paint, SKY_DOME, gloss).photograph(camera, Quality(256, 1), seed=0)
        for gloss in (None, Gloss.white(np.zeros(count), 0.2))
    )
    np.testing.assert_allclose(glossy.mean(axis=(0, 1)), diffuse.mean(axis=(0, 1)), rtol=0.005)


def test_smoothing_moves_each_vertex_to_the_mean_of_its_neighbours_and_itself():
    """Two steps by hand on a tetrahedron beside a lone triangle: every vertex neighbours every other."""
    rng = np.random.default_rng(0)
    vertices = rng.uniform(-1, 1, (7, 3))
    faces = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0], [4, 5, 6]], np.int32)
    smoothed = laplacian_smoothing(Surface(vertices, faces), 1)
    np.testing.assert_array_equal(smoothed.faces, faces)
    np.testing.assert_allclose(smoothed.vertices[:4], np.tile(vertices[:4].mean(axis=0), (4, 1)))
    np.testing.assert_allclose(smoothed.vertices[4:], np.tile(vertices[4:].mean(axis=0), (3, 1)))


def test_more_steps_smooth_more_and_none_is_the_same_mesh():
    rough = Surface(
        ball().vertices + np.random.default_rng(2).normal(0, 0.01, ball().vertices.shape), ball().faces
    )
    assert laplacian_smoothing(rough, 0) is rough

    def roughness(surface: Surface) -> float:
        return float(np.linalg.norm(surface.vertices, axis=1).std())

    once, often = laplacian_smoothing(rough, 1), laplacian_smoothing(rough, 5)
    assert roughness(rough) > 1.5 * roughness(once) > 1.5 * roughness(often) > 0
    np.testing.assert_allclose(
        often.vertices, laplacian_smoothing(laplacian_smoothing(rough, 2), 3).vertices, atol=1e-12
    )


def test_faces_that_share_places_and_no_vertices_are_smoothed_as_one_surface():
    """As in STL: otherwise every face would shrink to a point."""
    whole = ball()
    faces = np.arange(whole.faces.size, dtype=np.int32).reshape(-1, 3)
    apart = laplacian_smoothing(Surface(whole.vertices[whole.faces].reshape(-1, 3), faces), 20)
    together = laplacian_smoothing(whole, 20)
    np.testing.assert_array_equal(apart.faces, faces)
    np.testing.assert_allclose(apart.vertices, together.vertices[whole.faces].reshape(-1, 3), atol=1e-12)


def test_vertex_colours_are_decoded_from_srgb(tmp_path):
    mesh = to_open3d(ball(0.1))
    encoded = np.random.default_rng(0).integers(0, 256, (len(mesh.vertices), 3))
    encoded[:3] = [[0, 10, 11], [128, 188, 255], [64, 1, 254]]
    mesh.vertex_colors = o3d.utility.Vector3dVector(encoded / 255)
    o3d.io.write_triangle_mesh(str(tmp_path / "ball.ply"), mesh)
    linear = read_vertex_colours(tmp_path / "ball.ply")
    assert linear.dtype == np.float32
    expected = np.where(encoded <= 10, encoded / 255 / 12.92, ((encoded / 255 + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(linear, expected, rtol=1e-4)
    np.testing.assert_allclose(linear[1], [0.215861, 0.502886, 1.0], rtol=1e-5)


def test_a_mesh_without_colours_is_named(tmp_path):
    write_mesh(tmp_path / "plain.ply", ball(0.1))
    with pytest.raises(UserError, match="plain.ply has no vertex colours"):
        read_vertex_colours(tmp_path / "plain.ply")
