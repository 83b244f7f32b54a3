"""The view graph: every view has its best observers, all that can be is connected, no more than asked."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from stages.correspondence import CORRESPONDENCE
from stages.formats.artefacts.camera_file import write_cameras
from stages.formats.images.exr import write_exr
from stages.formats.images.photos import write_mask
from stages.geometry.covisibility.surface_points import SurfacePoints
from stages.geometry.covisibility.view_graph import best_observers, best_pairs
from stages.scene.cameras import Camera
from stages.scene.pairs import all_pairs

VIEWS, SIDE = 30, 24


def plane_camera(x: float, z: float = 10.0, name: str = "view") -> Camera:
    """Looks along world z from (x, 0, 0) at a plane at this depth, 60° wide."""
    focal = SIDE / 2 / np.tan(np.radians(30))
    intrinsics = np.array([[focal, 0, SIDE / 2], [0, focal, SIDE / 2], [0, 0, 1]])
    return Camera(name, SIDE, SIDE, intrinsics, np.column_stack([np.eye(3), [-x, 0, 10.0 - z]]))


def plane_view(z: float = 10.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth, normals and mask of a view of that plane."""
    depth, normals = np.full((SIDE, SIDE), z), np.zeros((SIDE, SIDE, 3))
    normals[..., 2] = -1
    return depth, normals, np.ones((SIDE, SIDE), bool)


def sharpness_along_a_wall(places: list[float]) -> tuple[sp.csr_array, np.ndarray]:
    """Views along a wall, each 11.5 wide, and how sharply each shows the points of all."""
    depth, normals, mask = plane_view()
    cameras = [plane_camera(x) for x in places]
    points = SurfacePoints.together(
        [SurfacePoints.sampled(one, depth, normals, mask, 100) for one in cameras]
    )
    table = np.zeros((len(points.points), len(cameras)))
    for j, one in enumerate(cameras):
        seen, sharpness = points.sharpness_in(one, depth, mask, 3.0)
        table[seen, j] = sharpness
    return sp.csr_array(table), np.repeat(np.arange(len(places)), len(table) // len(places))


def connected(pairs: list[tuple[int, int]], count: int) -> int:
    """Number of parts of the graph."""
    one, other = np.transpose(pairs)
    return connected_components(sp.csr_array((np.ones(len(pairs)), (one, other)), shape=(count, count)))[0]


def test_along_a_wall_neighbours_are_linked_and_the_number_of_pairs_is_linear():
    sharpness, owners = sharpness_along_a_wall([float(x) for x in range(VIEWS)])
    pairs = best_pairs(sharpness, owners, 4)
    assert len(pairs) <= 4 * VIEWS + VIEWS - 1
    assert connected(pairs, VIEWS) == 1
    assert max(j - i for i, j in pairs) < 12  # no farther than surface is shared
    degree = np.bincount(np.ravel(pairs), minlength=VIEWS)
    assert degree.min() >= 4
    assert pairs == sorted(set(pairs)) and all(i < j for i, j in pairs)


def test_each_part_of_a_view_keeps_an_observer():
    """Ten views of the left half of the first, one of its right half, which shows less of it, but alone."""
    sharpness, owners = sharpness_along_a_wall([0.0, *np.linspace(-6, -5, 10), 7.0])
    assert 11 in best_observers(sp.csc_array(sharpness[owners == 0]), 0, 2)


def test_two_groups_that_share_little_are_connected():
    """Every view has enough good neighbours in its own group."""
    places = [*np.linspace(0, 1, 8), *np.linspace(11, 12, 8)]
    sharpness, owners = sharpness_along_a_wall(places)
    pairs = best_pairs(sharpness, owners, 3)
    assert connected(pairs, 16) == 1
    assert sum(i < 8 <= j for i, j in pairs) >= 1


def test_views_that_share_nothing_stay_apart():
    pairs = best_pairs(*sharpness_along_a_wall([0.0, 1.0, 100.0, 101.0]), 3)
    assert pairs == [(0, 1), (2, 3)]


def test_sharpness_is_the_cosine_times_pixels_per_length():
    depth, normals, mask = plane_view()
    camera = plane_camera(0.0)
    one = SurfacePoints.sampled(camera, depth, normals, mask, SIDE * SIDE)
    seen, sharpness = one.sharpness_in(camera, depth, mask, 3.0)
    way = camera.centre_in_world - one.points
    expected = np.abs(way[:, 2]) / np.linalg.norm(way, axis=1) * camera.focal_px / 10
    assert np.array_equal(seen, np.arange(SIDE * SIDE))
    assert sharpness == pytest.approx(expected)
    turned = SurfacePoints(one.points, -one.normals, one.footprints)
    assert len(turned.sharpness_in(camera, depth, mask, 3.0)[0]) == 0


@pytest.mark.parametrize("neighbours", [0, 3, 12])
def test_the_stage_links_few_views_where_there_are_many(tmp_path, make_job, neighbours):
    inputs = {kind: tmp_path / kind for kind in ("depth", "normal", "mask")}
    cameras = [plane_camera(float(x), name=f"{x:02d}") for x in range(14)]
    depth, normals, mask = plane_view()
    for folder in inputs.values():
        folder.mkdir()
    for camera in cameras:
        write_exr(inputs["depth"] / f"{camera.name}.exr", depth.astype(np.float32))
        write_exr(inputs["normal"] / f"{camera.name}.exr", normals.astype(np.float32))
        write_mask(inputs["mask"] / f"{camera.name}.png", mask)
    write_cameras(tmp_path / "cameras.json", cameras)
    job = make_job(
        tmp_path / "job",
        CORRESPONDENCE,
        CORRESPONDENCE.settings(neighbours=neighbours, all_up_to=13),
        cameras=tmp_path / "cameras.json",
        **inputs,
    )
    CORRESPONDENCE.run(job)
    rows = json.loads((job.outputs["correspondences"] / "index.json").read_text())
    pairs = [(int(row["i"]), int(row["j"])) for row in rows]
    if neighbours == 0:
        assert pairs == all_pairs(14)
    else:
        assert len(pairs) < len(all_pairs(14)) and connected(pairs, 14) == 1
        assert all(row["links"] > 0 for row in rows)
