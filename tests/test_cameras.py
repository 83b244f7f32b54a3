"""Every crossing of CONVENTIONS.md that cameras make, and π itself (Eq. 7)."""

import numpy as np
import pytest

from stages.formats.artefacts.camera_file import read_cameras, write_cameras
from stages.scene.cameras import (
    Camera,
    back_project,
    footprint,
    intrinsics_for_integer_centres,
    normals_in_cam,
    normals_in_world,
    pixel_centres,
    project,
    rays_in_world,
    view_name,
    xy_for_integer_centres,
)


@pytest.fixture
def camera() -> Camera:
    """90° about z: world x is the camera's y, world y is its −x; shifted, with unequal focal lengths."""
    intrinsics = np.array([[100.0, 0, 30], [0, 110.0, 20], [0, 0, 1]])
    pose = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3]])
    return Camera("a/b", 64, 48, intrinsics, pose)


def test_eq_7_projection_by_hand(camera):
    """Eq. 7: for X = (2, 4, 7), R X + t = (−3, 4, 10); p = (100 · −0.3 + 30, 110 · 0.4 + 20)."""
    xy, depth = project(camera, np.array([2.0, 4.0, 7.0]))
    assert depth == 10.0
    assert np.allclose(xy, [0.0, 64.0])


def test_eq_7_points_behind_the_camera_have_no_positive_depth(camera):
    _, depth = project(camera, np.array([[0.0, 0, -3], [0, 0, -10]]))
    assert depth.tolist() == [0.0, -7.0]


def test_back_projection_undoes_projection(camera):
    depth = np.random.default_rng(0).uniform(1, 5, camera.shape)
    xy, seen = project(camera, back_project(camera, depth))
    assert np.allclose(seen, depth)
    assert np.allclose(xy, pixel_centres(64, 48))


def test_the_camera_is_where_everything_projects_from(camera):
    in_cam = camera.rotation @ camera.centre_in_world + camera.cam_from_world[:, 3]
    assert np.allclose(in_cam, 0)
    assert np.allclose(camera.centre_in_world, [-2, 1, -3])


def test_rays_have_unit_depth_not_unit_length(camera):
    rays = rays_in_world(camera)
    assert np.allclose(rays @ camera.rotation[2], 1)


def test_the_first_pixel_s_centre_is_half_half():
    centres = pixel_centres(4, 3)
    assert centres.shape == (3, 4, 2)
    assert centres[0, 0].tolist() == [0.5, 0.5]
    assert centres[2, 3].tolist() == [3.5, 2.5]


def test_integer_centres_are_array_indices():
    index = np.stack(np.meshgrid(np.arange(4), np.arange(3)), axis=-1)
    assert np.array_equal(xy_for_integer_centres(pixel_centres(4, 3)), index)


def test_integer_centres_shift_the_principal_point_by_half_a_pixel(camera):
    shifted = intrinsics_for_integer_centres(camera.intrinsics)
    xy, _ = project(camera, np.array([0.3, -0.2, 1.0]))
    homogeneous = shifted @ (camera.rotation @ [0.3, -0.2, 1.0] + camera.cam_from_world[:, 3])
    assert np.allclose(homogeneous[:2] / homogeneous[2], xy - 0.5)
    assert camera.intrinsics[0, 2] == 30


def test_a_scaled_camera_sees_the_same_at_another_size(camera):
    """Image coordinates scale as they are, because pixel corners, not centres, are at integers."""
    half = camera.scaled(32, 24)
    x = np.array([[0.3, -0.2, 1.0], [1.0, 2.0, 5.0]])
    assert np.allclose(project(half, x)[0], project(camera, x)[0] / 2)
    assert half.shape == (24, 32)
    assert half.focal_px == camera.focal_px / 2


def test_normals_rotate_into_world_axes_and_back(camera):
    towards_camera = np.array([0.0, 0, -1])
    assert np.allclose(normals_in_world(camera, np.array([1.0, 0, 0])), [0, -1, 0])
    assert np.allclose(normals_in_world(camera, towards_camera), [0, 0, -1])
    some = np.random.default_rng(1).standard_normal((4, 5, 3))
    assert np.allclose(normals_in_cam(camera, normals_in_world(camera, some)), some)
    assert np.allclose(normals_in_world(camera, some), np.einsum("ij,...j->...i", camera.rotation.T, some))


def test_a_footprint_is_what_one_pixel_covers(camera):
    level = Camera("level", 64, 48, np.array([[100.0, 0, 32], [0, 100, 24], [0, 0, 1]]), np.eye(4)[:3])
    points = back_project(level, np.full(level.shape, 7.0))
    assert np.allclose(np.linalg.norm(np.diff(points, axis=1), axis=-1), footprint(level, 7.0))
    assert footprint(camera, 10.5) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("image", "name"), [("a.jpg", "a"), ("Straße 1/é.2.JPG", "Straße 1/é.2"), ("sub/x.tar.png", "sub/x.tar")]
)
def test_view_names_keep_folders_and_drop_extensions(image, name):
    assert view_name(image) == name


def test_camera_files_bring_back_what_was_written(camera, tmp_path):
    other = camera.scaled(17, 13)
    write_cameras(tmp_path / "cameras.json", [camera, other])
    for was, read in zip([camera, other], read_cameras(tmp_path / "cameras.json"), strict=True):
        assert (read.name, read.shape) == (was.name, was.shape)
        assert np.array_equal(read.intrinsics, was.intrinsics)
        assert np.array_equal(read.cam_from_world, was.cam_from_world)
