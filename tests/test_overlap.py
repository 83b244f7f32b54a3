"""Correspondences (Eq. 6, Eq. 8): known by hand on planes and spheres, one per row, ε in footprints."""

import numpy as np
import pytest

from stages.geometry.covisibility.correspondences import find_correspondences
from stages.scene.cameras import Camera, back_project, footprint
from tests.sphere_scene import sphere_scene


def camera(shift_px: float = 0.0, width: int = 8, height: int = 5, z: float = 10.0) -> Camera:
    """Looks along world z at a plane z = 10, f = 20 px; shifted so that its image moves by `shift_px`."""
    intrinsics = np.array([[20.0, 0, width / 2], [0, 20.0, height / 2], [0, 0, 1]])
    pose = np.column_stack([np.eye(3), [-shift_px * z / 20, 0, 0]])
    return Camera("view", width, height, intrinsics, pose)


def plane(depth: float = 10.0, shape: tuple[int, int] = (5, 8)) -> tuple[np.ndarray, np.ndarray]:
    return np.full(shape, depth), np.ones(shape, bool)


def test_eq_6_a_plane_seen_from_the_side_links_to_the_shifted_pixel():
    """Eq. 6: moved by 3 pixels, pixel (x, y) of i is pixel (x − 3, y) of j; three columns leave."""
    correspondences = find_correspondences(camera(), *plane(), camera(3.0), *plane(), epsilon=0.01).toarray()
    expected = np.zeros((40, 40), np.uint8)
    for y in range(5):
        for x in range(3, 8):
            expected[8 * y + x, 8 * y + x - 3] = 1
    assert np.array_equal(correspondences, expected)


@pytest.mark.parametrize(("gap_footprints", "linked"), [(2.9, True), (3.1, False)])
@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_eq_8_epsilon_counts_footprints_whatever_the_unit_of_length(gap_footprints, linked, scale):
    """Eq. 8: one surface 2.9 footprints before the other passes for the same, 3.1 does not (Deviation 4)."""
    one = camera(z=10.0)
    farther = 10.0 * scale
    # The larger footprint is the farther pixel's: gap = g · farther / f.
    nearer = farther * (1 - gap_footprints / 20)
    width, height = 1, 1
    central = Camera(
        "c", width, height, np.array([[20.0, 0, 0.5], [0, 20.0, 0.5], [0, 0, 1]]), one.cam_from_world
    )
    correspondences = find_correspondences(
        central, *plane(nearer, (1, 1)), central, *plane(farther, (1, 1)), epsilon=3.0
    )
    assert correspondences.nnz == int(linked)


def test_masks_number_the_rows_and_columns():
    mask_i, mask_j = np.zeros((5, 8), bool), np.zeros((5, 8), bool)
    mask_i[2, [1, 4]] = True
    mask_j[2, [0, 4, 6]] = True
    depth = np.full((5, 8), 10.0)
    correspondences = find_correspondences(camera(), depth, mask_i, camera(), depth, mask_j, epsilon=0.5)
    assert correspondences.toarray().tolist() == [[0, 0, 0], [0, 1, 0]]


def test_pixels_without_depth_and_points_behind_link_to_nothing():
    depth, mask = plane()
    behind = Camera("b", 8, 5, camera().intrinsics, np.column_stack([np.diag([-1.0, 1, -1]), np.zeros(3)]))
    assert find_correspondences(camera(), 0 * depth, mask, camera(), depth, mask, epsilon=3).nnz == 0
    assert find_correspondences(camera(), depth, mask, camera(), 0 * depth, mask, epsilon=3).nnz == 0
    assert find_correspondences(camera(), depth, mask, behind, depth, mask, epsilon=3).nnz == 0


def test_equals_go_to_the_first_in_row_order():
    """Shifted by half a pixel, two pixels of j are equally near: the left one is taken, every time."""
    intrinsics = np.array([[16.0, 0, 4], [0, 16, 2], [0, 0, 1]])  # powers of two: distances are exact
    views = [
        Camera("v", 8, 5, intrinsics, np.column_stack([np.eye(3), [shift, 0, 0]])) for shift in (0, -0.5)
    ]
    correspondences = find_correspondences(views[0], *plane(16.0), views[1], *plane(16.0), epsilon=3.0)
    x, row_x = correspondences.indices % 8, np.flatnonzero(np.diff(correspondences.indptr)) % 8
    assert np.array_equal(x, np.maximum(row_x - 1, 0))


def test_c_has_at_most_one_1_per_row_and_links_are_close():
    """Eq. 8 on a sphere: every link within 3 footprints, at most one per row, most common pixels linked."""
    scene = sphere_scene(3)
    for (i, j), correspondences in scene.correspondences.items():
        assert np.diff(correspondences.indptr).max() == 1
        assert set(correspondences.data) == {1}
        rows, columns = correspondences.tocoo().coords
        x_i = back_project(scene.cameras[i], scene.depths[i])[scene.masks[i]][rows]
        x_j = back_project(scene.cameras[j], scene.depths[j])[scene.masks[j]][columns]
        size_i = footprint(scene.cameras[i], scene.depths[i])[scene.masks[i]][rows]
        size_j = footprint(scene.cameras[j], scene.depths[j])[scene.masks[j]][columns]
        assert np.all(np.linalg.norm(x_i - x_j, axis=1) <= 3 * np.maximum(size_i, size_j))
        assert correspondences.nnz > 0.6 * scene.masks[i].sum()


def test_the_partner_is_the_nearest_point_of_all():
    """The 3 × 3 candidates hold the argmin of Eq. 8 over the whole view wherever the surface faces both."""
    scene = sphere_scene(2)
    correspondences = scene.correspondences[0, 1]
    x_i, x_j = (
        back_project(c, d)[m] for c, d, m in zip(scene.cameras, scene.depths, scene.masks, strict=True)
    )
    rows, columns = correspondences.tocoo().coords
    facing = np.sum(x_i[rows] * (scene.cameras[1].centre_in_world - x_i[rows]), axis=1) > 1.0
    distances = np.linalg.norm(x_i[rows][:, None] - x_j[None], axis=2)
    chosen = distances[np.arange(rows.size), columns]
    assert facing.sum() > 300
    assert np.allclose(chosen[facing], distances.min(axis=1)[facing])


def test_occluded_points_are_not_linked():
    """A near square hides part of a far plane from j; seen from i beside it, what it hides stays alone."""
    depth_j, mask = plane(10.0, (9, 9))
    depth_j[3:6, 3:6] = 5.0
    side = Camera("i", 9, 9, np.array([[20.0, 0, 4.5], [0, 20.0, 4.5], [0, 0, 1]]), camera().cam_from_world)
    correspondences = find_correspondences(side, *plane(10.0, (9, 9)), side, depth_j, mask, epsilon=3.0)
    linked = np.diff(correspondences.indptr).reshape(9, 9).astype(bool)
    assert not linked[4, 4]
    assert linked[[0, 1, 7, 8]].all()
