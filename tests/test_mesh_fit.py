"""A mesh beside the surface that the photos show: it is said to be, and its rims are not used."""

from __future__ import annotations

import re

import numpy as np
import pycolmap
import pytest

from stages.formats.colmap.model import pinhole_model
from stages.formats.images.photos import read_mask, write_mask
from stages.formats.meshes.triangle_meshes import Surface, write_mesh
from stages.geometry.outlines.mesh_fit import beyond_outline, gaps_at_points
from stages.geometry.rays import RayCaster
from stages.raycast import RAYCAST, RAYCAST_OF_GIVEN_SURFACE, FitCheckSettings, RaycastSettings
from stages.scene.cameras import Camera, project
from stages.stereo.workspace import open_workspace
from tests.test_surface import SQUARE, camera

GAP = FitCheckSettings().largest_gap


def on_the_square(count: int) -> np.ndarray:
    xy = np.random.default_rng(0).uniform(-0.9, 0.9, (count, 2))
    return np.column_stack([xy, np.full(count, 4.0)])


def test_the_gap_is_along_the_depth_and_points_beside_the_mesh_say_nothing():
    depth = RayCaster(SQUARE).see(camera()).depth
    near, beside, behind_the_camera = on_the_square(20) - [0, 0, 0.3], [[1.5, 0, 4.0]], [[0, 0, -4.0]]
    gaps = gaps_at_points(camera(), depth, np.concatenate([near, beside, behind_the_camera]))
    np.testing.assert_allclose(gaps, np.full(20, 0.3), rtol=1e-5)


def test_every_view_has_the_points_that_it_observed(tmp_path):
    model_of(tmp_path / "sparse", 60)
    workspace = open_workspace(tmp_path)
    points, names = workspace.points, [own.name for own in workspace.cameras]
    found = {name: points.x_in_world[seen] for name, seen in zip(names, points.seen, strict=True)}
    assert {name: len(points) for name, points in found.items()} == {"a": 60, "b": 60}
    np.testing.assert_allclose(found["a"], on_the_square(60))


def model_of(folder, count: int) -> None:
    """Two cameras before the square, and points on it that both have observed."""
    cameras = [Camera(name, 40, 30, camera().intrinsics, camera(centre=(x, 0, 0)).cam_from_world)
               for name, x in (("a", 0.0), ("b", 0.2))]  # fmt: skip
    model = pinhole_model(cameras)
    points = on_the_square(count)
    for image_id, own in zip(sorted(model.images), cameras, strict=True):
        xy, _ = project(own, points)
        model.images[image_id].points2D = pycolmap.Point2DList([pycolmap.Point2D(each) for each in xy])
    for number, point in enumerate(points):
        elements = [pycolmap.TrackElement(image_id, number) for image_id in sorted(model.images)]
        model.add_point3D(point, pycolmap.Track(elements))
    folder.mkdir(parents=True, exist_ok=True)
    model.write(folder)


@pytest.mark.parametrize(
    ("moved", "count", "said"),
    [
        (lambda v: v, 60, None),
        (lambda v: v + [0, 0, 0.9 * GAP * np.hypot(2, 2)], 60, None),
        (
            lambda v: v + [0, 0, 1.1 * GAP * np.hypot(2, 2)],
            60,
            "of 120 sightings .* 120 of the 120 on it lie more",
        ),
        (lambda v: 1.5 * v, 60, "120 of the 120 on it lie more than 5% of its size"),
        (lambda v: 0.2 * v + [1.2, 0.8, 3.0], 60, "of 120 sightings of sparse points none falls on it"),
        (lambda v: 1.5 * v, 20, None),
    ],
)
def test_a_mesh_in_another_frame_is_said_to_be(make_job, tmp_path, moved, count, said):
    model_of(tmp_path / "workspace/sparse", count)
    write_mesh(tmp_path / "mesh.ply", Surface(moved(SQUARE.vertices), SQUARE.faces))
    (tmp_path / "kept").mkdir()
    inputs = {name: tmp_path / file for name, file in (("mesh", "mesh.ply"), ("workspace", "workspace"))}
    job = make_job(tmp_path / "out", RAYCAST_OF_GIVEN_SURFACE, kept=tmp_path / "kept", **inputs)
    RAYCAST_OF_GIVEN_SURFACE.run(job)
    assert len(job.warnings) == (said is not None)
    assert said is None or re.search(said, job.warnings[0])


def test_background_counts_near_the_outline_alone_and_not_along_the_border_of_the_photo():
    mask = np.zeros((20, 30), bool)
    mask[:, 10:] = True
    background = np.zeros_like(mask)
    background[:5, :14] = background[:, 20:] = True
    beyond = np.zeros_like(mask)
    beyond[:6, 10:14] = True
    np.testing.assert_array_equal(beyond_outline(mask, background, 3), beyond)
    assert not beyond_outline(mask, background, 0).any()


@pytest.mark.parametrize(("reduce", "outline_px", "taken"), [(1, 3.0, 4), (1, 0.0, 0), (2, 4.0, 3)])
def test_a_view_does_not_use_the_rim_that_its_photo_shows_as_background(
    make_job, tmp_path, reduce, outline_px, taken
):
    model_of(tmp_path / "workspace/sparse", 60)
    write_mesh(tmp_path / "mesh.ply", SQUARE)
    kept, background = tmp_path / "kept", tmp_path / "background"
    kept.mkdir()
    sky = np.zeros((30, 40), bool)
    sky[:, :20] = True
    write_mask(background / "a.png", sky)
    folders = {"kept": kept, "background": background, "workspace": tmp_path / "workspace"}

    def masks(stage, settings=None):
        job = make_job(tmp_path / f"{len(folders)}", stage, settings, mesh=tmp_path / "mesh.ply", **folders)
        stage.run(job)
        return job, [read_mask(job.outputs["mask"] / f"{name}.png") for name in ("a", "b")]

    job, found = masks(RAYCAST, RaycastSettings(reduce=reduce, outline_px=outline_px))
    folders.pop("background")
    _, whole = masks(RAYCAST_OF_GIVEN_SURFACE, RaycastSettings(reduce=reduce))
    np.testing.assert_array_equal(found[1], whole[1])
    row = whole[0].shape[0] // 2
    assert whole[0][row].sum() - found[0][row].sum() == taken
    assert found[0][row, 20 // reduce + 1 :].sum() == whole[0][row, 20 // reduce + 1 :].sum()
    assert job.facts["beyond_outlines"] == whole[0].sum() - found[0].sum()
