"""A workspace that has been through COLMAP's dense reconstruction is taken up where COLMAP left it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from stages.cli import main
from stages.formats.meshes.ply import write_ply
from stages.formats.meshes.point_clouds import read_cloud, write_points
from stages.formats.meshes.triangle_meshes import read_mesh
from stages.stereo.workspace import write_depth_maps
from tests import stereo_scene

VIEWS = stereo_scene.cameras()
SURFACE = {"mvs", "mesh", "adopt_depth_maps", "adopt_points", "adopt_mesh"}


@pytest.fixture(scope="module")
def fused(tmp_path_factory) -> Path:
    """COLMAP's undistorter and fusion on photos and a model, with true depth in place of PatchMatch."""
    project, dense = tmp_path_factory.mktemp("project"), tmp_path_factory.mktemp("dense") / "0"
    stereo_scene.write_workspace(project, VIEWS)
    pycolmap.undistort_images(dense, project / "sparse", project / "images")
    for camera in VIEWS:
        traced = stereo_scene.trace(camera)
        depth, normals = traced.depth.astype(np.float32), traced.normals.astype(np.float32)
        write_depth_maps(dense / "stereo", f"{camera.name}.png", camera, depth, normals)
    options = pycolmap.StereoFusionOptions()
    options.min_num_pixels, options.num_threads = 3, 1
    pycolmap.stereo_fusion(dense / "fused.ply", dense, options=options, output_type="PLY")
    return dense


@pytest.fixture
def dense(fused, tmp_path) -> Path:
    """A workspace of this test's own, as far as the fused points."""
    return Path(shutil.copytree(fused, tmp_path / "dense"))


def with_mesh(dense: Path, name: str) -> Path:
    """COLMAP's Poisson mesh, written under a name of one of its meshers."""
    options = pycolmap.PoissonMeshingOptions(depth=6, trim=3, num_threads=1)
    pycolmap.poisson_meshing(dense / "fused.ply", dense / name, options)
    return dense / name


def surface_stages(capsys, verb: str, workspace: Path, *words: str | Path) -> tuple[set[str], str]:
    """The stages that make the surface, and what the command said on the way."""
    capsys.readouterr()
    line = [verb, "--workspace", workspace, "--to", "raycast", "--json", *words]
    code, (told, said) = main([str(word) for word in line]), capsys.readouterr()
    assert code == 0, said
    rows = json.loads(told)
    rows = rows["stages"] if isinstance(rows, dict) else rows
    sentences = [json.loads(line).get("sentence", "") for line in said.splitlines()]
    return {row["stage"] for row in rows} & SURFACE, " ".join(sentences)


def result(workspace: Path, stage: str, name: str) -> Path:
    (path,) = (workspace / "cache" / stage).glob(f"*/{name}")
    return path


def off_the_scene(x_in_world: np.ndarray) -> np.ndarray:
    off_ball = np.abs(np.linalg.norm(x_in_world - stereo_scene.CENTRE, axis=1) - stereo_scene.RADIUS)
    return np.minimum(off_ball, np.abs(x_in_world @ stereo_scene.WALL_NORMAL - stereo_scene.WALL_OFFSET))


def test_fused_points_take_the_place_of_stereo(capsys, dense, tmp_path):
    """From the folder alone: its images, its model and its points; and it is said."""
    made, said = surface_stages(capsys, "run", tmp_path / "w", "--colmap", dense)
    assert made == {"adopt_points", "mesh"}
    assert f"Uses the cloud {dense / 'fused.ply'}, as COLMAP made it." in said
    for one, theirs in zip(
        read_cloud(result(tmp_path / "w", "adopt_points", "fused.ply")),
        read_cloud(dense / "fused.ply"),
        strict=True,
    ):
        np.testing.assert_allclose(one, theirs, atol=1e-6)  # normals of unit length again
    surface = read_mesh(result(tmp_path / "w", "mesh", "mesh.ply"))
    assert np.quantile(off_the_scene(surface.vertices), 0.9) < 0.05
    record = json.loads(result(tmp_path / "w", "undistort", "record.json").read_text())
    assert record["facts"]["resampled"] == 0  # they are pinhole images already


@pytest.mark.parametrize("name", ["meshed-poisson.ply", "meshed-delaunay.ply"])
def test_a_mesh_of_colmap_takes_the_place_of_stereo_and_mesh(name, capsys, dense, tmp_path):
    mesh = with_mesh(dense, name)
    made, said = surface_stages(capsys, "run", tmp_path / "w", "--colmap", dense)
    assert made == {"adopt_mesh"}
    assert f"Uses the mesh {mesh}, as COLMAP made it." in said
    ours, theirs = read_mesh(result(tmp_path / "w", "adopt_mesh", "mesh.ply")), read_mesh(mesh)
    assert len(ours.faces) > 0.99 * len(theirs.faces) > 100  # without triangles of no area


def test_of_two_meshes_poisson_s_is_used_and_the_user_s_own_before_both(capsys, dense, tmp_path):
    mesh = with_mesh(dense, "meshed-poisson.ply")
    shutil.copy(mesh, dense / "meshed-delaunay.ply")
    shutil.copy(mesh, tmp_path / "own.ply")
    assert f"Uses the mesh {mesh}" in surface_stages(capsys, "plan", tmp_path / "w", "--colmap", dense)[1]
    own = ["--mesh", tmp_path / "own.ply"]
    assert "Uses" not in surface_stages(capsys, "plan", tmp_path / "w", "--colmap", dense, *own)[1]


def test_the_sentence_says_how_to_do_without_and_that_works(capsys, dense, tmp_path):
    _, said = surface_stages(capsys, "plan", tmp_path / "w", "--colmap", dense)
    words = said.partition("To make one anew, give ")[2].partition(". ")[0].rstrip(".").split(" ")
    assert words == ["--colmap", str(dense / "sparse"), "--images", str(dense / "images")]
    assert surface_stages(capsys, "plan", tmp_path / "w", *words)[0] == {"mvs", "mesh"}


def test_depth_maps_that_were_not_fused_are_fused(capsys, dense, tmp_path):
    """Half a pixel nearer to the truth than COLMAP's own fusion, which takes indices for coordinates."""
    theirs, _, _ = read_cloud(dense / "fused.ply")
    (dense / "fused.ply").unlink()
    as_theirs = ["--set", "adopt_depth_maps.fusion_views=3"]
    made, said = surface_stages(capsys, "run", tmp_path / "w", "--colmap", dense, *as_theirs)
    assert made == {"adopt_depth_maps", "mesh"}
    assert f"Uses the depth maps of {dense}, as COLMAP made them." in said
    ours, _, _ = read_cloud(result(tmp_path / "w", "adopt_depth_maps", "fused.ply"))
    assert len(ours) > 0.9 * len(theirs) > 1000
    assert np.median(off_the_scene(ours)) < 0.2 * np.median(off_the_scene(theirs))
    surface = read_mesh(result(tmp_path / "w", "mesh", "mesh.ply"))
    assert np.quantile(off_the_scene(surface.vertices), 0.9) < 0.05
    shutil.rmtree(dense / "stereo")
    assert "depth maps" not in surface_stages(capsys, "plan", tmp_path / "w", "--colmap", dense)[1]


def test_depth_maps_are_taken_from_a_folder_that_is_named_and_a_view_may_lack_them(capsys, dense, tmp_path):
    shutil.rmtree(dense / "stereo" / "consistency_graphs")
    (dense / "fused.ply").unlink()
    lost = sorted((dense / "stereo/normal_maps").glob("*.geometric.bin"))[0]
    lost.unlink()
    words = ["--colmap", dense / "sparse", "--images", dense / "images", "--points", dense]
    made, _ = surface_stages(capsys, "run", tmp_path / "w", *words)
    assert made == {"adopt_depth_maps", "mesh"}
    record = json.loads(result(tmp_path / "w", "adopt_depth_maps", "record.json").read_text())
    assert record["facts"]["views"] == len(VIEWS) - 1
    assert f"have no depth map or no normal map ({lost.name.removesuffix('.geometric.bin')})" in " ".join(
        record["warnings"]
    )


def test_damaged_or_missing_depth_maps_are_a_sentence(capsys, dense, tmp_path):
    words = ["run", "--colmap", dense / "sparse", "--images", dense / "images", "--points", dense]
    words += ["--workspace", tmp_path / "w", "--to", "adopt_depth_maps"]
    maps = sorted((dense / "stereo/depth_maps").glob("*.geometric.bin"))
    maps[1].write_bytes(maps[1].read_bytes()[:-4])
    assert main([str(word) for word in words]) == 2
    assert "It was cut off" in " ".join(capsys.readouterr().err.split())
    for one in maps:
        one.unlink()
    assert main([str(word) for word in words]) == 2
    assert "holds no image with a depth map and a normal map" in " ".join(capsys.readouterr().err.split())


def test_other_points_are_another_surface(capsys, dense, tmp_path):
    """A cached run equals a fresh one: what COLMAP fused anew is read anew, and nothing else runs again."""

    def plan() -> dict[str, str]:
        capsys.readouterr()
        assert main(["plan", "--colmap", str(dense), "--workspace", str(tmp_path / "w"), "--json"]) == 0
        return {row["stage"]: row["action"] for row in json.loads(capsys.readouterr().out)}

    surface_stages(capsys, "run", tmp_path / "w", "--colmap", dense)
    assert {plan()[stage] for stage in ("adopt_points", "mesh", "raycast")} == {"reuse"}
    x_in_world, normals, colours = read_cloud(dense / "fused.ply")
    write_points(dense / "fused.ply", x_in_world[::2], normals[::2], colours[::2])
    after = plan()
    assert after["adopt_model"] == after["undistort"] == "reuse"
    assert after["adopt_points"] == "run" and after["mesh"] == "run or reuse"


def test_a_mesh_without_faces_is_refused_and_the_way_around_it_was_said(capsys, dense, tmp_path):
    """As COLMAP's Poisson leaves it where it trims all away."""
    write_ply(
        dense / "meshed-poisson.ply",
        dict.fromkeys("xyz", np.zeros(3, np.float32)),
        np.zeros((0, 3), np.int32),
    )
    capsys.readouterr()
    assert main(["run", "--colmap", str(dense), "--workspace", str(tmp_path / "w"), "--to", "mesh"]) == 2
    assert main(["run", "--colmap", str(dense), "--workspace", str(tmp_path / "w"), "--to", "raycast"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "meshed-poisson.ply gave no faces" in said and "To make one anew, give --colmap" in said
