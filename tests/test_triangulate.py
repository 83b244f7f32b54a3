"""Points of views whose cameras are known: on the surface, the same every time, from views that see alike."""

from __future__ import annotations

import filecmp
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import open3d as o3d
import pytest

from stages.adopt_model import ADOPT_MODEL
from stages.formats.colmap.model import pinhole_model, read_model
from stages.formats.meshes.triangle_meshes import read_mesh
from stages.motion.known_poses.settings import TriangulationSettings
from stages.motion.known_poses.triangulation import near_pairs
from stages.scene.cameras import Camera
from stages.synthetic.views import look_at
from stages.triangulate import TRIANGULATE
from stages.undistort import UNDISTORT

SAMPLE = Path(__file__).parent.parent / "sample_data"


def camera_at(centre: list[float], target: list[float]) -> Camera:
    intrinsics = np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]])
    return Camera("v", 100, 80, intrinsics, look_at(np.array(centre), np.array(target)))


def test_views_are_matched_with_the_nearest_that_look_the_same_way():
    row = [camera_at([x, -2.0, 0], [x, 0, 0]) for x in range(6)]
    behind = camera_at([2.5, 2.0, 0], [2.5, 0, 0])  # from the other side
    pairs = near_pairs([*row, behind], TriangulationSettings(neighbours=2))
    assert pairs == [(0, 1), (0, 2), (1, 2), (2, 3), (3, 4), (3, 5), (4, 5)]
    assert near_pairs([row[0], behind], TriangulationSettings()) == []


@pytest.fixture(scope="module")
def workspace(tmp_path_factory, make_job) -> Path:
    """The sample's linear views, undistorted, in a workspace without points."""
    folder = tmp_path_factory.mktemp("posed")
    images = SAMPLE / "linear/images"
    adopt = make_job(folder / "adopt", ADOPT_MODEL, None, colmap=SAMPLE / "linear", images=images)
    ADOPT_MODEL.run(adopt)
    assert not read_model(adopt.outputs["model"]).points3D
    undistort = make_job(folder / "undistort", UNDISTORT, None, images=images, model=adopt.outputs["model"])
    UNDISTORT.run(undistort)
    return undistort.outputs["workspace"]


@pytest.fixture(scope="module")
def points(workspace, tmp_path_factory, make_job) -> Path:
    job = make_job(tmp_path_factory.mktemp("points") / "out", TRIANGULATE, None, 2, workspace=workspace)
    TRIANGULATE.run(job)
    return job.outputs["sparse_points"]


def test_points_lie_on_the_true_surface(workspace, points):
    model, surface = read_model(points), read_mesh(SAMPLE / "truth/mesh.ply")
    assert {image.name for image in model.images.values()} == {
        image.name for image in read_model(workspace / "sparse").images.values()
    }
    places = np.array([point.xyz for point in model.points3D.values()], np.float32)
    assert len(places) > 100
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(surface.vertices.astype(np.float32), surface.faces.astype(np.uint32))
    apart = scene.compute_distance(o3d.core.Tensor(places)).numpy()
    assert np.median(apart) < 2e-3 * np.ptp(surface.vertices, axis=0).max()


def test_the_same_points_with_one_thread(workspace, points, tmp_path, make_job):
    job = make_job(tmp_path / "out", TRIANGULATE, None, 1, workspace=workspace)
    TRIANGULATE.run(job)
    same, other, unread = filecmp.cmpfiles(
        points, job.outputs["sparse_points"], sorted(path.name for path in points.iterdir()), shallow=False
    )
    assert same and not other and not unread


def test_few_points_say_less_than_the_poses_and_are_not_kept(workspace, points, tmp_path, make_job):
    most = TriangulationSettings(fewest_points=len(read_model(points).points3D) + 1)
    job = make_job(tmp_path / "out", TRIANGULATE, most, workspace=workspace)
    TRIANGULATE.run(job)
    assert job.facts["points"] == 0


def test_points_that_the_model_has_are_kept(points, workspace, tmp_path, make_job):
    (tmp_path / "workspace").mkdir()
    (tmp_path / "workspace/sparse").symlink_to(points)
    job = make_job(tmp_path / "out", TRIANGULATE, None, workspace=tmp_path / "workspace")
    TRIANGULATE.run(job)  # there are no images
    assert job.facts["given"] and job.facts["points"] == len(read_model(points).points3D)


def test_views_of_nothing_have_no_points(tmp_path, make_job):
    """Stereo then takes what stands in for points."""
    cameras = [replace(camera_at([x, -2.0, 0], [x, 0, 0]), name=f"{x}") for x in range(3)]
    pinhole_model(cameras).write(_created(tmp_path / "workspace/sparse"))
    for camera in cameras:
        picture = np.full((80, 100, 3), 128, np.uint8)
        cv2.imwrite(str(_created(tmp_path / "workspace/images") / f"{camera.name}.png"), picture)
    job = make_job(tmp_path / "out", TRIANGULATE, None, workspace=tmp_path / "workspace")
    TRIANGULATE.run(job)
    assert job.facts["points"] == 0 and not job.facts["given"]


def _created(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder
