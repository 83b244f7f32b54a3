"""COLMAP's dense results: fused points taken up with `--points`, what lies beside a model told of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import open3d as o3d
import pytest

from pipeline import UserError
from stages.adopt_points import ADOPT_POINTS
from stages.cli import main
from stages.formats.meshes.ply import write_ply
from stages.formats.meshes.point_clouds import read_cloud, write_points
from stages.formats.meshes.triangle_meshes import read_mesh

SAMPLE = Path(__file__).parent.parent / "sample_data"


@pytest.fixture(scope="module")
def cloud() -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of the sample's surface."""
    mesh = o3d.io.read_triangle_mesh(str(SAMPLE / "truth/mesh.ply"))
    mesh.compute_vertex_normals()
    return np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals)


def colmap_project(folder: Path) -> Path:
    (folder / "sparse").symlink_to(SAMPLE / "linear/sparse")
    (folder / "dense").mkdir()
    return folder


def test_fused_points_become_the_mesh_without_stereo(cloud, tmp_path, capsys):
    x_in_world, normals = cloud
    write_points(tmp_path / "fused.ply", x_in_world, normals, np.zeros(x_in_world.shape, np.uint8))
    words = ["run", "--colmap", SAMPLE / "linear", "--points", tmp_path / "fused.ply"]
    words += ["--workspace", tmp_path / "w", "--to", "mesh"]
    assert main([str(word) for word in words]) == 0
    told = capsys.readouterr().err
    assert "adopt_points" in told and "mvs" not in told
    surface = read_mesh(tmp_path / "w/output/mesh.ply")
    off = np.abs(surface.vertices[:, None] - x_in_world[None, ::50]).max(axis=2).min(axis=1)
    assert np.median(off) < 0.02 * np.ptp(x_in_world, axis=0).max()


def test_points_of_no_use_are_left_out_aloud(cloud, make_job, tmp_path):
    x_in_world, normals = (one[:100].copy() for one in cloud)
    x_in_world[0], x_in_world[1], normals[2], normals[3] = np.nan, 1e20, 0, np.inf
    normals *= 3
    columns = dict(zip(("x", "y", "z", "nx", "ny", "nz"), np.hstack([x_in_world, normals]).T, strict=True))
    write_ply(tmp_path / "p.ply", columns)
    job = make_job(tmp_path / "out", ADOPT_POINTS, points_file=tmp_path / "p.ply")
    ADOPT_POINTS.run(job)
    assert "4 of the 100 points have no place or no normal" in job.warnings[0]
    kept, turned, _ = read_cloud(job.outputs["fused"])
    np.testing.assert_allclose(kept, x_in_world[4:], rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1, rtol=1e-6)


@pytest.mark.parametrize(
    ("normal", "says"), [(0.0, "none with a place and a normal"), (None, "without normals")]
)
def test_a_cloud_of_no_use_is_a_sentence(normal, says, make_job, tmp_path):
    columns = {name: np.ones(5, "f4") for name in "xyz"}
    columns |= {} if normal is None else {name: np.full(5, normal, "f4") for name in ("nx", "ny", "nz")}
    write_ply(tmp_path / "p.ply", columns)
    job = make_job(tmp_path / "out", ADOPT_POINTS, points_file=tmp_path / "p.ply")
    with pytest.raises(UserError, match=says):
        ADOPT_POINTS.run(job)


def test_a_cloud_that_was_cut_off_is_a_sentence(cloud, make_job, tmp_path):
    x_in_world, normals = cloud
    write_points(tmp_path / "p.ply", x_in_world, normals, np.zeros(x_in_world.shape, np.uint8))
    whole = (tmp_path / "p.ply").read_bytes()
    (tmp_path / "p.ply").write_bytes(whole[: len(whole) // 2])
    job = make_job(tmp_path / "out", ADOPT_POINTS, points_file=tmp_path / "p.ply")
    with pytest.raises(UserError, match="it was cut off"):
        ADOPT_POINTS.run(job)


def test_dense_results_beside_a_model_are_told_of_and_how_to_take_them(tmp_path, capsys):
    project = colmap_project(tmp_path)
    words = ["plan", "--colmap", str(project), "--images", str(SAMPLE / "linear/images"), "--workspace", "w"]
    assert main(words) == 0
    assert "not used" not in capsys.readouterr().err
    for name in ("fused.ply", "meshed-poisson.ply"):
        (project / "dense" / name).write_bytes(b"")
    assert main(words) == 0
    told = " ".join(capsys.readouterr().err.split())
    dense = project / "dense"
    assert f"add --mesh {dense}/meshed-poisson.ply." in told
    assert main([*words, "--mesh", str(SAMPLE / "truth/mesh.ply")]) == 0
    assert "not used" not in capsys.readouterr().err


def test_points_need_cameras_and_no_mesh(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("p.ply").write_bytes(b"")
    words = ["plan", "--images", str(SAMPLE / "linear/images"), "--points", "p.ply", "--workspace", "w"]
    assert main(words) == 2
    assert "--points was given without --colmap or --cameras" in " ".join(capsys.readouterr().err.split())
    assert main([*words, "--mesh", "p.ply", "--colmap", str(SAMPLE / "linear")]) == 2
    assert "--mesh and --points were given" in " ".join(capsys.readouterr().err.split())
