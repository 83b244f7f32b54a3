"""The engine `cuda` of `mvs`: what COLMAP's stereo is given, and, where there is a card, what it finds."""

from __future__ import annotations

import numpy as np
import pycolmap
import pytest

from pipeline import UserError
from stages.formats.colmap.model import read_model
from stages.formats.meshes.point_clouds import read_cloud
from stages.mvs import MVS, MvsSettings, engine_of
from stages.stereo.colmap_stereo import fusion_options, write_colmap_workspace
from stages.stereo.cuda_cards import count_cards
from stages.stereo.workspace import Workspace, open_workspace, write_depth_maps
from tests import stereo_scene

VIEWS = stereo_scene.cameras()
TRACED = [stereo_scene.trace(camera) for camera in VIEWS]
FOOTPRINT = 4.3 / VIEWS[0].focal_px
on_a_card = pytest.mark.skipif(count_cards() == 0, reason="takes pycolmap-cuda12 and an NVIDIA card")


def off_the_surface(x_in_world: np.ndarray) -> np.ndarray:
    """Distances of points from the ball or the wall, the nearer one, shape (n,)."""
    off_ball = np.linalg.norm(x_in_world - stereo_scene.CENTRE, axis=1) - stereo_scene.RADIUS
    off_wall = x_in_world @ stereo_scene.WALL_NORMAL - stereo_scene.WALL_OFFSET
    return np.minimum(np.abs(off_ball), np.abs(off_wall))


def of_the_scene(folder, *, points: bool) -> Workspace:
    return open_workspace(stereo_scene.write_workspace(folder, VIEWS, points=points))


def test_auto_is_our_own_stereo_on_any_machine(monkeypatch):
    """Its results are those of a machine without a card, and may be taken from the cache of one."""
    monkeypatch.setattr(pycolmap, "has_cuda", True)
    monkeypatch.setattr(pycolmap, "get_num_cuda_devices", lambda: 1, raising=False)
    assert engine_of(MvsSettings()) == {"engine": "cpu"}
    assert engine_of(MvsSettings(engine="cuda")) == {"engine": "cuda"}


@pytest.mark.parametrize(
    ("has_cuda", "message"), [(False, "without CUDA.*engine=cpu"), (True, "no NVIDIA card.*engine=cpu")]
)
def test_the_engine_without_a_card_is_refused_before_colmap_ends_the_process(
    tmp_path, make_job, monkeypatch, has_cuda, message
):
    monkeypatch.setattr(pycolmap, "has_cuda", has_cuda)
    monkeypatch.setattr(pycolmap, "get_num_cuda_devices", lambda: 0, raising=False)
    workspace = stereo_scene.write_workspace(tmp_path / "w", VIEWS)
    job = make_job(tmp_path / "out", MVS, MvsSettings(engine="cuda"), workspace=workspace)
    with pytest.raises(UserError, match=message):
        MVS.run(job)


@pytest.mark.parametrize("points", [True, False])
@pytest.mark.parametrize("shift", [np.zeros(3), np.array([500_000.0, 5_700_000.0, 120.0])])
def test_colmap_fuses_true_depth_on_the_true_surface(tmp_path, points, shift):
    """Half a pixel off, as with COLMAP's own intrinsics, points of slanted surface would leave it.

    So would they in metres of UTM, where its single precision knows half a metre.
    """
    made = stereo_scene.write_workspace(tmp_path / "w", VIEWS, points=points)
    model = pycolmap.Reconstruction(made / "sparse")
    model.transform(pycolmap.Sim3d(1, pycolmap.Rotation3d(), shift))
    model.write(made / "sparse")
    workspace, folder = open_workspace(made), tmp_path / "for COLMAP"
    origin = write_colmap_workspace(workspace, folder, MvsSettings())
    for name, camera, traced in zip(workspace.image_names, VIEWS, TRACED, strict=True):
        write_depth_maps(folder / "stereo", name, camera, traced.depth.astype(np.float32), traced.normals)
    options = fusion_options(MvsSettings(), len(VIEWS))
    pycolmap.stereo_fusion(tmp_path / "fused.ply", folder, options=options, output_type="PLY")
    x_from_origin, _, _ = read_cloud(tmp_path / "fused.ply")
    assert len(x_from_origin) > 5000
    assert np.median(off_the_surface(x_from_origin + origin - shift)) < 0.02 * FOOTPRINT


def test_stand_ins_give_colmap_neighbours_and_depths_where_there_are_no_points(tmp_path):
    workspace = of_the_scene(tmp_path / "w", points=False)
    folder = tmp_path / "for COLMAP"
    write_colmap_workspace(workspace, folder, MvsSettings())
    model = read_model(folder / "sparse")
    assert not read_model(workspace.folder / "sparse").points3D
    for image in model.images.values():
        observed = [model.points3D[point.point3D_id] for point in image.points2D if point.has_point3D()]
        depth = [(image.cam_from_world() * point.xyz)[2] for point in observed]
        assert 0 < min(depth) < 3 < 6 < max(depth)
        assert len({one.image_id for point in observed for one in point.track.elements}) == len(VIEWS)


@pytest.fixture(scope="module", params=[True, False], ids=["with points", "poses alone"])
def finished(request, tmp_path_factory, make_job):
    workspace = stereo_scene.write_workspace(tmp_path_factory.mktemp("w") / "w", VIEWS, points=request.param)
    job = make_job(
        tmp_path_factory.mktemp("out"),
        MVS,
        MvsSettings(engine="cuda", consistent_views=1),
        workspace=workspace,
    )
    MVS.run(job)
    return job


@on_a_card
def test_depth_normals_and_points_of_the_card_meet_the_truth(finished):
    depths, normals, covered = stereo_scene.beside_truth(finished.outputs["depth_maps"])
    assert np.median(depths) < 0.5
    assert np.median(normals) < 12
    assert np.mean(covered) > 0.5
    x_in_world, _, _ = read_cloud(finished.outputs["fused"])
    assert len(x_in_world) == finished.facts["fused_points"] > 1000
    assert np.median(off_the_surface(x_in_world)) < 0.5 * FOOTPRINT


@on_a_card
def test_the_card_gives_the_same_bytes_again(finished, make_job, tmp_path):
    again = make_job(tmp_path, MVS, finished.settings, workspace=finished.inputs["workspace"])
    MVS.run(again)
    for file in finished.outputs["depth_maps"].rglob("*.bin"):
        same = again.outputs["depth_maps"] / file.relative_to(finished.outputs["depth_maps"])
        assert file.read_bytes() == same.read_bytes(), file.name
    assert finished.outputs["fused"].read_bytes() == again.outputs["fused"].read_bytes()
