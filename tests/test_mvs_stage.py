"""The mvs stage on a tiny traced workspace, and the files that it writes."""

from __future__ import annotations

import copy
import shutil
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import open3d
import pycolmap
import pytest
from scipy.spatial import cKDTree

from pipeline import UserError
from stages.formats.artefacts.array_store import ArrayStore
from stages.formats.colmap.depth_maps import read_map, write_map
from stages.formats.meshes.point_clouds import read_cloud, read_points
from stages.mvs import MVS, MvsSettings
from stages.scene.cameras import footprint
from stages.stereo import workspace as workspaces
from tests import stereo_scene

VIEWS = stereo_scene.cameras()
TRACED = [stereo_scene.trace(camera) for camera in VIEWS]
QUICK = {"engine": "cpu", "sweep_scale": 1.0, "patch_radius_px": 4, "sources": 4}


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    return stereo_scene.write_workspace(tmp_path_factory.mktemp("workspace"), VIEWS)


@pytest.fixture(scope="module")
def finished(tmp_path_factory, make_job, workspace):
    job = make_job(tmp_path_factory.mktemp("mvs"), MVS, MvsSettings(**QUICK), workspace=workspace)
    MVS.run(job)
    return job


def maps(job, view):
    folder, name = job.outputs["depth_maps"], f"{VIEWS[view].name}.png.geometric.bin"
    return read_map(folder / "depth_maps" / name), read_map(folder / "normal_maps" / name)


def test_depth_and_normals_meet_the_truth(finished):
    depths, normals, covered = stereo_scene.beside_truth(finished.outputs["depth_maps"])
    assert np.median(depths) < 0.5
    assert np.median(normals) < 8
    assert np.mean(covered) > 0.7


def test_the_sky_stays_empty_beyond_the_reach_of_a_patch(finished):
    for view, traced in enumerate(TRACED):
        sky = (traced.depth == 0).astype(np.uint8)
        assert sky.sum() > 500
        far = cv2.distanceTransform(sky, cv2.DIST_L2, 5) > 1.5 * QUICK["patch_radius_px"]
        found = maps(finished, view)[0] > 0
        assert not (found & far).any()
        assert np.mean(found[sky > 0]) < 0.15


def test_the_fused_cloud_is_on_the_surface_and_says_so(finished):
    x_in_world, normals, _ = read_points(finished.outputs["fused"])
    assert len(x_in_world) == finished.facts["fused_points"] > 1000
    assert finished.facts["engine"] == "cpu"
    off_ball = np.abs(np.linalg.norm(x_in_world - stereo_scene.CENTRE, axis=1) - stereo_scene.RADIUS)
    off_wall = np.abs(x_in_world @ stereo_scene.WALL_NORMAL - stereo_scene.WALL_OFFSET)
    assert np.quantile(np.minimum(off_ball, off_wall), 0.9) < 0.05
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-4)
    assert set(finished.facts["coverage"]) == {f"{camera.name}.png" for camera in VIEWS}


def test_a_georeferenced_scene_is_fused_as_finely(tmp_path, make_job, workspace, finished):
    """In metres of UTM; numbers of single precision are half a metre apart there."""
    shift = np.array([500_000.0, 5_700_000.0, 120.0])
    shutil.copytree(workspace, tmp_path / "w")
    model = pycolmap.Reconstruction(workspace / "sparse")
    model.transform(pycolmap.Sim3d(1, pycolmap.Rotation3d(), shift))
    model.write(tmp_path / "w/sparse")
    job = make_job(tmp_path, MVS, MvsSettings(**QUICK), workspace=tmp_path / "w")
    MVS.run(job)
    (far, _, _), (near, _, _) = (read_points(one.outputs["fused"]) for one in (job, finished))
    assert len(far) == pytest.approx(len(near), rel=0.01)
    apart, _ = cKDTree(near).query(far - shift)
    assert np.quantile(apart, 0.99) < 0.01


def test_another_number_of_threads_gives_the_same_bytes(finished, tmp_path, make_job, workspace):
    again = make_job(tmp_path, MVS, MvsSettings(**QUICK), threads=1, workspace=workspace)
    MVS.run(again)
    for view in range(len(VIEWS)):
        for one, other in zip(maps(finished, view), maps(again, view), strict=True):
            np.testing.assert_array_equal(one, other)
    assert finished.outputs["fused"].read_bytes() == again.outputs["fused"].read_bytes()


def test_without_the_geometric_pass_the_photometric_one_stands(finished, tmp_path, make_job, workspace):
    job = make_job(tmp_path, MVS, MvsSettings(**QUICK, geometric_iterations=0), workspace=workspace)
    MVS.run(job)
    for name, share in finished.facts["coverage"].items():
        assert job.facts["coverage"][name] > 0.7 * share
    assert job.facts["fused_points"] > 1000


def test_poses_alone_are_enough(tmp_path, make_job):
    workspace = stereo_scene.write_workspace(tmp_path / "w", VIEWS[:4], points=False)
    (tmp_path / "out").mkdir()
    job = make_job(tmp_path / "out", MVS, MvsSettings(**QUICK), workspace=workspace)
    MVS.run(job)
    depth, _ = maps(job, 1)
    both = (depth > 0) & (TRACED[1].depth > 0)
    assert both.sum() > 0.5 * (TRACED[1].depth > 0).sum()
    gap = np.abs(depth - TRACED[1].depth)[both] / footprint(VIEWS[1], TRACED[1].depth[both])
    assert np.median(gap) < 0.7


def test_sparse_points_are_a_fallback_that_is_said_aloud(tmp_path, make_job, workspace):
    job = make_job(tmp_path, MVS, MvsSettings(engine="sparse"), workspace=workspace)
    MVS.run(job)
    assert "sparse points alone" in job.warnings[0]
    assert job.facts["engine"] == "sparse"
    assert len(read_points(job.outputs["fused"])[0]) == job.facts["fused_points"] > 100
    assert not maps(job, 0)[0].any()


def test_auto_falls_back_when_the_views_agree_on_too_few_points(tmp_path, make_job, workspace, monkeypatch):
    monkeypatch.setattr(pycolmap, "has_cuda", False)
    settings = MvsSettings(fewest_points=10**9)
    job = make_job(tmp_path, MVS, settings, workspace=workspace)
    MVS.run(job)
    assert "falling back to the sparse points" in " ".join(job.warnings)
    assert job.facts["engine"] == "sparse"


def test_one_view_is_no_stereo(tmp_path, make_job):
    workspace = stereo_scene.write_workspace(tmp_path / "w", VIEWS[:1], points=False)
    (tmp_path / "out").mkdir()
    with pytest.raises(UserError, match="at least 2"):
        MVS.run(make_job(tmp_path / "out", MVS, MvsSettings(**QUICK), workspace=workspace))


def test_a_view_that_looks_away_from_everything_is_left_out_aloud(tmp_path, make_job):
    away = replace(VIEWS[0], name="view away", cam_from_world=np.diag([-1, 1, -1]) @ VIEWS[0].cam_from_world)
    workspace = stereo_scene.write_workspace(tmp_path / "w", [*VIEWS[:4], away])
    (tmp_path / "out").mkdir()
    job = make_job(tmp_path / "out", MVS, MvsSettings(**QUICK), workspace=workspace)
    MVS.run(job)
    assert job.warnings == ["No other view shares surface with view away.png: without depth there."]
    assert job.facts["fused_points"] > 1000


def test_views_from_one_place_are_no_stereo(tmp_path, make_job):
    turned = [replace(c, cam_from_world=np.column_stack([c.rotation, np.zeros(3)])) for c in VIEWS[:3]]
    workspace = stereo_scene.write_workspace(tmp_path / "w", turned, points=False)
    (tmp_path / "out").mkdir()
    with pytest.raises(UserError, match="No two of the 3 posed views .* from different places"):
        MVS.run(make_job(tmp_path / "out", MVS, MvsSettings(**QUICK), workspace=workspace))


def test_depth_maps_are_colmap_s_byte_for_byte(tmp_path):
    values = np.arange(6, dtype=np.float32).reshape(2, 3)
    write_map(tmp_path / "ours.bin", values)
    assert (tmp_path / "ours.bin").read_bytes() == b"3&2&1&" + values.astype("<f4").tobytes()
    theirs = pycolmap.DepthMap()
    theirs.read(tmp_path / "ours.bin")
    np.testing.assert_array_equal(theirs.to_array(), values)
    theirs.write(tmp_path / "theirs.bin")
    np.testing.assert_array_equal(read_map(tmp_path / "theirs.bin"), values)


def test_normal_maps_are_colmap_s(tmp_path):
    values = np.random.default_rng(0).normal(size=(4, 5, 3)).astype(np.float32)
    values[..., 2] = -np.abs(values[..., 2])  # towards the camera
    values /= np.linalg.norm(values, axis=-1, keepdims=True)
    write_map(tmp_path / "ours.bin", values)
    np.testing.assert_array_equal(read_map(tmp_path / "ours.bin"), values)
    theirs = pycolmap.NormalMap()
    theirs.read(tmp_path / "ours.bin")
    # pycolmap 4.2's to_array and from_array mix the planes up; its picture and its fusion (below) do not.
    picture = theirs.to_bitmap().to_array().astype(float)
    np.testing.assert_allclose(picture[..., :2], 127.5 * (1 - values[..., :2]), atol=1)
    np.testing.assert_allclose(picture[..., 2], -255 * values[..., 2], atol=1)


def test_colmap_s_own_fusion_takes_our_maps(finished, workspace, tmp_path):
    shutil.copytree(workspace, tmp_path / "w")
    shutil.copytree(finished.outputs["depth_maps"], tmp_path / "w" / "stereo")
    names = "".join(f"{camera.name}.png\n" for camera in VIEWS)
    (tmp_path / "w" / "stereo" / "fusion.cfg").write_text(names)
    options = pycolmap.StereoFusionOptions()
    options.min_num_pixels, options.num_threads = 3, 1
    pycolmap.stereo_fusion(tmp_path / "fused.ply", tmp_path / "w", options=options, output_type="PLY")
    x_in_world, normals, colours = read_cloud(tmp_path / "fused.ply")
    theirs = open3d.io.read_point_cloud(tmp_path / "fused.ply")
    np.testing.assert_array_equal(x_in_world, theirs.points)
    np.testing.assert_array_equal(normals, np.array(theirs.normals, np.float32))
    np.testing.assert_array_equal(colours, np.rint(np.asarray(theirs.colors) * 255))
    off_wall = np.abs(x_in_world @ stereo_scene.WALL_NORMAL - stereo_scene.WALL_OFFSET)
    assert (off_wall < 0.02).sum() > 500
    assert np.median(normals[off_wall < 0.02] @ stereo_scene.WALL_NORMAL) > 0.98


@pytest.mark.parametrize(
    ("data", "message"), [(b"\x89PNG....", "no COLMAP"), (b"3&2&1&1234", "cut off"), (b"0&2&1&", "no COLMAP")]
)
def test_broken_maps_are_named(tmp_path, data, message):
    (tmp_path / "broken.bin").write_bytes(data)
    with pytest.raises(UserError, match=rf"broken\.bin.*{message}"):
        read_map(tmp_path / "broken.bin")


def test_the_array_store_is_a_mapping(tmp_path):
    store = ArrayStore(tmp_path / "arrays")
    store[3] = np.eye(2)
    store[10] = np.zeros(1)
    assert list(store) == [3, 10]
    np.testing.assert_array_equal(store[3], np.eye(2))
    del store[3]
    assert 3 not in store
    with pytest.raises(KeyError):
        store[3]


def test_threads_share_a_reader_of_images(workspace, monkeypatch):
    """With room for one image, views are read again and again; none is asked for after it was dropped."""
    monkeypatch.setattr(workspaces, "IMAGES_HELD", 1)
    reader = workspaces.open_workspace(workspace).images()
    alone = [reader(view) for view in range(len(VIEWS))]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as executor:
            views = [number % len(VIEWS) for number in range(4000)]
            for view, image in zip(views, executor.map(reader, views), strict=True):
                assert np.array_equal(image, alone[view])
    finally:
        sys.setswitchinterval(interval)
    assert np.array_equal(copy.copy(reader)(0), alone[0])  # by what pickle takes


def test_smaller_sizes_add_points_and_leave_depth_maps_as_they_are(finished, tmp_path, make_job):
    assert finished.facts["points_of_smaller_sizes"] == 0  # 120 px are few already
    larger = stereo_scene.cameras(width=240, height=180)
    at_twice = stereo_scene.write_workspace(tmp_path / "workspace", larger)
    half, never = (
        make_job(
            tmp_path / str(least), MVS, MvsSettings(**QUICK, gaps={"least_px": least}), workspace=at_twice
        )
        for least in (100, 1000)
    )
    for job in (half, never):
        MVS.run(job)
    added = half.facts["points_of_smaller_sizes"]
    assert added == half.facts["fused_points"] - never.facts["fused_points"] > 0
    x_in_world, _, sizes = read_points(half.outputs["fused"])
    first, _, _ = read_points(never.outputs["fused"])
    np.testing.assert_array_equal(x_in_world[: len(first)], first)
    np.testing.assert_array_equal(sizes, np.repeat([1, 2], [len(first), added]))
    off_ball = np.abs(np.linalg.norm(x_in_world - stereo_scene.CENTRE, axis=1) - stereo_scene.RADIUS)
    off_wall = np.abs(x_in_world @ stereo_scene.WALL_NORMAL - stereo_scene.WALL_OFFSET)
    off = np.minimum(off_ball, off_wall)[len(first) :]
    assert np.quantile(off, 0.5) < 0.05
    for camera in larger:
        name = f"{camera.name}.png.geometric.bin"
        one, other = (job.outputs["depth_maps"] / "depth_maps" / name for job in (half, never))
        assert one.read_bytes() == other.read_bytes()
