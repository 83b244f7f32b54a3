"""Trimming of surface to what was seen, and gaps that stay closed, where the answer is known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from stages.formats.colmap.depth_maps import write_map
from stages.formats.colmap.model import pinhole_model
from stages.formats.images.photos import write_mask
from stages.formats.meshes.point_clouds import write_points
from stages.formats.meshes.triangle_meshes import Surface, read_mesh
from stages.geometry import trimming
from stages.geometry.settings import SurfaceGapSettings
from stages.geometry.surface import OrientedPoints, poisson
from stages.geometry.trimming import (
    Sightings,
    before_background,
    gaps_not_seen_through,
    sightings,
    trim_to_points,
)
from stages.mesh import MESH, MESH_OF_GIVEN_POINTS, MeshSettings
from stages.scene.cameras import project
from tests.sphere_scene import camera_looking_at_origin, points_of_a_sphere

CLOSED = SurfaceGapSettings()


def grid_sheet(at: np.ndarray) -> Surface:
    """A flat sheet, z = 0, with a vertex at every pair of coordinates."""
    x, y = np.meshgrid(at, at)
    place = np.arange(x.size, dtype=np.int32).reshape(x.shape)
    a, b, c, d = (part.ravel() for part in (place[:-1, :-1], place[1:, :-1], place[:-1, 1:], place[1:, 1:]))
    faces = np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])
    return Surface(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1), faces)


def test_surface_far_from_every_point_is_trimmed_away():
    points = points_of_a_sphere(6000)
    cap_seen = points.chosen(points.x_in_world[:, 2] > 0.2)
    surface = trim_to_points(
        poisson(cap_seen, depth=6),
        cap_seen,
        reach_footprints=6.0,
        rim_footprints=6.0,
        in_background=nowhere,
        closed_gaps=none,
    )
    distance = np.linalg.norm(surface.vertices[:, None, :] - cap_seen.x_in_world[None, ::10], axis=2).min(
        axis=1
    )
    assert surface.vertices[:, 2].min() > 0.2 - 6 * 0.03 - 1e-6
    assert len(surface.faces) > 0
    assert distance.max() < 0.4


def nowhere(positions: np.ndarray) -> np.ndarray:
    """No view shows background."""
    return np.zeros(len(positions), bool)


def none(surface: Surface, far: np.ndarray, footprints: np.ndarray) -> np.ndarray:
    """No gap is closed."""
    return np.zeros_like(far)


def test_a_rim_before_background_goes_and_everything_else_stays():
    """A square of points with a hole in it, on a larger sheet; sky is to the right, and seen in the hole."""
    sheet = grid_sheet(np.arange(-30, 31) / 10)  # a vertex every tenth
    x, y = sheet.vertices[:, 0], sheet.vertices[:, 1]
    seen = (np.abs(x) <= 2) & (np.abs(y) <= 2) & (np.hypot(x, y) >= 0.5)
    up = np.tile([0.0, 0, 1], (seen.sum(), 1))
    points = OrientedPoints(sheet.vertices[seen], up, np.full(seen.sum(), 0.1), np.ones(seen.sum()))

    def to_the_right(positions):
        return (positions[:, 0] > 0) | (np.abs(positions[:, :2]) < 0.3).all(axis=1)

    kept = trim_to_points(
        sheet, points, 6.5, rim_footprints=3.5, in_background=to_the_right, closed_gaps=none
    ).vertices
    assert kept[:, 0].max() == pytest.approx(2.3) and kept[:, 0].min() == pytest.approx(-2.6)
    assert np.hypot(*kept[:, :2].T).min() == 0  # far from every point, before sky, but enclosed


def test_points_of_larger_pixels_hold_surface_farther_from_them(make_job, tmp_path):
    """A wall whose middle has a point every twenty pixels only, as a quarter of the size may have found."""
    camera = camera_looking_at_origin("0", np.array([0, -5.0, 0]), 200, 200, 1000.0)
    sparse = tmp_path / "workspace/sparse"
    sparse.mkdir(parents=True)
    pinhole_model([camera]).write(sparse)
    column, row = (part.ravel() for part in np.mgrid[-100:100, -100:100])
    middle = np.maximum(abs(column), abs(row)) < 60
    there = ~middle | ((column % 20 == 0) & (row % 20 == 0))
    wall = np.stack([column, 0 * row, row], axis=-1)[there] * 0.005  # a pixel's footprint apart
    towards_camera = np.tile([0.0, -1, 0], (len(wall), 1))
    vertices_there = []
    for pixel_size in (1, 4):
        fused, sizes = tmp_path / f"{pixel_size}.ply", np.where(middle, pixel_size, 1)[there]
        write_points(fused, wall, towards_camera, np.zeros(wall.shape, np.uint8), sizes)
        inputs = {"workspace": tmp_path / "workspace", "fused": fused}
        job = make_job(tmp_path / str(pixel_size), MESH_OF_GIVEN_POINTS, MeshSettings(depth=6), **inputs)
        MESH_OF_GIVEN_POINTS.run(job)
        x_in_world = read_mesh(job.outputs["mesh"]).vertices
        vertices_there.append((np.abs(x_in_world[:, [0, 2]]).max(axis=1) < 0.25).sum())
    assert vertices_there[0] < 0.6 * vertices_there[1]


def test_what_is_before_a_background_is_where_any_view_shows_some():
    first = camera_looking_at_origin("0", np.array([0, -5.0, 0]), 40, 30, 40.0)
    other = camera_looking_at_origin("1", np.array([5.0, 0, 0]), 40, 30, 40.0)
    left = np.arange(40) < 20
    masks = {"0": np.broadcast_to(left, (30, 40)), "1": None}
    positions = np.array([[0.5, 0, 0.1], [-0.5, 0, 0.1], [0, -9.0, 0], [50.0, 0, 0]])
    xy, _ = project(first, positions)
    found = before_background(positions, [first, other], lambda one: masks[one.name])
    np.testing.assert_array_equal(found, [*(xy[:2, 0] < 20), False, False])
    assert found[:2].sum() == 1  # the third is behind the camera, the last beside its image


def test_trimming_takes_as_many_threads_as_it_is_given(monkeypatch):
    asked = []

    class Tree(cKDTree):
        def query(self, x, workers):
            asked.append(workers)
            return super().query(x, workers=workers)

    monkeypatch.setattr(trimming, "cKDTree", Tree)
    trim_to_points(
        grid_sheet(np.arange(3.0)), points_of_a_sphere(100), 1000.0, 1000.0, nowhere, none, threads=2
    )
    assert asked == [2]


def sheet_with_gaps(*middles: tuple[float, float]) -> tuple[Surface, np.ndarray, np.ndarray]:
    """A sheet with a vertex every tenth, its vertices within .5 of the middles, and how far they are."""
    sheet = grid_sheet(np.arange(-30, 31) / 10)
    apart = np.stack([np.hypot(*(sheet.vertices[:, :2] - middle).T) for middle in middles]).min(axis=0)
    return sheet, apart < 0.5, np.where(apart < 0.5, 10 * (0.6 - apart), 0)


@pytest.mark.parametrize(
    ("seen", "through", "background", "closed"),
    [
        (4, 0, 0, True),
        (1, 0, 0, False),
        (10, 1, 0, False),
        (100, 4, 0, True),
        (7, 0, 1, True),
        (7, 0, 5, False),
    ],
)
def test_a_gap_is_closed_where_views_see_it_and_neither_through_it_nor_sky(seen, through, background, closed):
    sheet, far, footprints = sheet_with_gaps((0.0, 0.0))

    def told(positions):
        return Sightings(*(np.full(len(positions), count) for count in (seen, through, background)))

    found = gaps_not_seen_through(sheet, far, footprints, told, CLOSED)
    np.testing.assert_array_equal(found, far & closed)


def test_gaps_are_told_apart_and_those_at_the_border_or_too_wide_stay_open():
    sheet, far, footprints = sheet_with_gaps((0.0, 0.0), (-1.5, 1.0), (2.9, 0.0))
    x, y = sheet.vertices[:, 0], sheet.vertices[:, 1]

    def through_the_left(positions):
        count = np.full(len(positions), 5)
        return Sightings(count, np.where(positions[:, 0] < -1, 5, 0), 0 * count)

    found = gaps_not_seen_through(sheet, far, footprints, through_the_left, CLOSED)
    np.testing.assert_array_equal(found, np.hypot(x, y) < 0.5)
    narrow = CLOSED.model_copy(update={"reach_footprints": 5.0})
    assert not gaps_not_seen_through(sheet, far, footprints, through_the_left, narrow).any()


def test_sightings_of_what_is_hidden_open_or_before_sky():
    """Of four places: the depth map shows nothing, surface behind, surface in front, and sky."""
    camera = camera_looking_at_origin("0", np.array([0, -5.0, 0]), 40, 30, 40.0)
    elsewhere = camera_looking_at_origin("1", np.array([0, 0.5, 0]), 40, 30, 40.0)  # with its back to them
    positions = np.array([[-1.0, 1, 0], [0, 1, 0], [1, 1, 0], [0, 1, 1]])
    xy, _ = project(camera, positions)
    column, row = xy.astype(int).T
    depth, background = np.zeros((30, 40)), np.zeros((30, 40), bool)
    depth[row[1], column[1]], depth[row[2], column[2]] = 7, 5
    background[row[3], column[3]] = True
    told = {"0": background, "1": None}
    found = sightings(positions, [camera, elsewhere], lambda _: depth, lambda one: told[one.name], 0.01)
    np.testing.assert_array_equal(found.seen, [1, 1, 0, 1])
    np.testing.assert_array_equal(found.through, [0, 1, 0, 0])
    np.testing.assert_array_equal(found.background, [0, 0, 0, 1])


@pytest.mark.parametrize(("around", "behind"), [(5.0, 0.0), (5.0, 8.0), (0.0, 0.0)])
def test_the_mesh_closes_a_gap_of_the_cloud_that_views_see_and_not_through(
    make_job, tmp_path, around, behind
):
    """A wall with a disc without points; depth maps that show the wall around it, or nothing at all."""
    places = [np.array([x, -5.0, 0]) for x in (0, 0.1)]
    cameras = [camera_looking_at_origin(str(x[0]), x, 200, 200, 1000.0) for x in places]
    inputs = {name: tmp_path / name for name in ("workspace", "depth_maps", "background")}
    (inputs["workspace"] / "sparse").mkdir(parents=True)
    pinhole_model(cameras).write(inputs["workspace"] / "sparse")
    column, row = np.mgrid[-100:100, -100:100]
    gap = np.hypot(column, row) <= 20
    wall = np.stack([column, 0 * row, row], axis=-1)[~gap] * 0.005
    write_points(tmp_path / "fused.ply", wall, np.tile([0.0, -1, 0], (len(wall), 1)), np.zeros(wall.shape))
    for camera in cameras:
        depth_map = inputs["depth_maps"] / f"depth_maps/{camera.name}.png.geometric.bin"
        write_map(depth_map, np.where(gap, behind, around))
        write_mask(inputs["background"] / f"{camera.name}.png", np.zeros((200, 200), bool))
    job = make_job(tmp_path / "out", MESH, MeshSettings(depth=6), fused=tmp_path / "fused.ply", **inputs)
    MESH.run(job)
    x_in_world = read_mesh(job.outputs["mesh"]).vertices
    closed = (np.hypot(x_in_world[:, 0], x_in_world[:, 2]) < 0.05).any()
    assert closed == (job.facts["vertices_of_closed_gaps"] > 0) == (around > behind)
