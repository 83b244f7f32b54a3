"""The command line as its users meet it, on the embedded sample, with real pycolmap and open3d."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pycolmap
import pytest
import trimesh

from benchmarks.texture.__main__ import main as rerendered
from pipeline.cache.store import Store
from stages import dataflow
from stages.cli import main
from stages.command.arguments import Plan
from stages.command.request import request_of
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask, read_photo, write_png_srgb8
from stages.formats.meshes.point_clouds import read_points

ROOT = Path(__file__).parent.parent
SAMPLE = ROOT / "sample_data"
QUICK = ["--set", "raycast.reduce=3", "--set", "transfer.max_vertices=30000"]
STAGES = [*(stage.name for stage in dataflow(["images"])), "report"]
LINEAR = ["--colmap", str(SAMPLE / "linear"), "--images", str(SAMPLE / "linear/images")]
LINEAR += ["--mesh", str(SAMPLE / "truth/mesh.ply")]
LINEAR_VIEWS = {"001", "003", "004", "009"}


def unshade(capsys, *words: str | Path) -> tuple[int, str, str]:
    """Exit code, output, error output of one command."""
    code = main([str(word) for word in words])
    return code, *capsys.readouterr()


def actions(text: str) -> dict[str, str]:
    """What a plan or run says of each stage, from its JSON."""
    rows = json.loads(text)
    rows = rows["stages"] if isinstance(rows, dict) else rows
    return {row["stage"]: row["action"] for row in rows}


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """The whole program run once on the sample's photos; not to be changed by a test."""
    workspace = tmp_path_factory.mktemp("story") / "workspace"
    assert main(["run", str(ROOT / "configs/sample.yaml"), "--workspace", str(workspace), *QUICK]) == 0
    return workspace


@pytest.fixture
def own_copy(finished, tmp_path) -> Path:
    """A finished workspace that a test may harm."""
    return Path(shutil.copytree(finished, tmp_path / "workspace"))


def test_a_folder_of_photos_in_the_configurations_place_is_told_apart(capsys):
    code, _, said = unshade(capsys, "run", SAMPLE / "photos")
    assert code == 2
    assert f"`--images {SAMPLE / 'photos'}`" in " ".join(said.split())


def test_from_photos_to_albedo(finished):
    output = finished / "output"
    names = sorted(path.stem for path in (SAMPLE / "photos").iterdir())
    for folder, suffixes in {
        "albedo": (".exr", ".png"),
        "shading": (".exr", ".png"),
        "depth": (".exr",),
        "normal": (".exr",),
        "mask": (".png",),
    }.items():
        for suffix in suffixes:
            assert sorted(p.stem for p in (output / folder).glob(f"*{suffix}")) == names
    for file in ("lighting.json", "energy.json", "png_scale.json", "cameras.json"):
        assert json.loads((output / file).read_text())
    assert (output / "contact_sheet.png").stat().st_size > 50_000


def test_albedo_times_shading_is_near_the_photo_and_nothing_lies_outside_the_mask(finished):
    """Eq. 1, where the robust data term says it should hold: for most pixels."""
    from stages.formats.images.resize import reduce_by_area

    (linear,) = (finished / "cache/undistort").glob("*/linear")
    for path in sorted((finished / "output/albedo").glob("*.exr"))[:3]:
        albedo, shading = read_exr(path), read_exr(finished / "output/shading" / path.name)
        mask = read_mask(finished / "output/mask" / f"{path.stem}.png")
        photo = reduce_by_area(read_exr(linear / path.name), mask.shape)
        assert (albedo[~mask] == 0).all()
        residual = np.abs(photo - albedo * shading)[mask]
        assert np.median(residual) < 0.1 * np.median(photo[mask])


def test_the_albedo_workspace_opens_in_colmap(finished):
    dense = finished / "output/dense"
    model = pycolmap.Reconstruction(dense / "sparse")
    names = {image.name for image in model.images.values()}
    assert names == {path.name for path in (dense / "images").iterdir()}
    options = pycolmap.StereoFusionOptions()
    options.num_threads = 1
    cloud = finished.parent / "albedo.ply"
    pycolmap.stereo_fusion(cloud, dense, options=options, output_type="PLY")
    assert len(read_points(cloud)[0]) > 1000


def test_a_second_run_reuses_everything_and_says_so(finished, capsys):
    code, _, said = unshade(capsys, "run", ROOT / "configs/sample.yaml", "--workspace", finished, *QUICK)
    assert code == 0
    (reused,) = [line for line in said.splitlines() if line.startswith("reuse")]
    flow = (
        "sfm undistort mvs mesh refine raycast correspondence transfer lighting decomposition export report"
    )
    assert reused.replace(",", "").split()[1:] == flow.split() and "done in" not in said
    _, told, _ = unshade(capsys, "plan", ROOT / "configs/sample.yaml", "--workspace", finished, *QUICK)
    assert told.count("nothing that it depends on has changed") == 12


def test_a_setting_of_the_decomposition_reruns_it_and_what_follows_only(finished, capsys):
    config = ROOT / "configs/sample.yaml"
    code, told, _ = unshade(
        capsys, "plan", config, "--workspace", finished, *QUICK, "--set", "decomposition.lambda=1.5", "--json"
    )
    assert code == 0
    plan = actions(told)
    assert {stage for stage, action in plan.items() if action != "reuse"} == {
        "decomposition", "export", "report",
    }  # fmt: skip
    reasons = {row["stage"]: row["reason"] for row in json.loads(told)}
    assert reasons["decomposition"].startswith("setting lambda went from")
    assert reasons["lighting"] == "nothing that it depends on has changed"


def test_a_setting_of_the_light_runs_both(finished, capsys):
    words = ["plan", ROOT / "configs/sample.yaml", "--workspace", finished, *QUICK, "--json"]
    code, told, _ = unshade(capsys, *words, "--set", "lighting.neutrality=0.01")
    assert code == 0
    plan = actions(told)
    assert plan["transfer"] == "reuse"
    assert [plan[stage] for stage in ("lighting", "decomposition")] == ["run", "run or reuse"]


def test_photos_elsewhere_are_the_same_photos_and_one_changed_byte_is_not(finished, tmp_path, capsys):
    photos = Path(shutil.copytree(SAMPLE / "photos", tmp_path / "elsewhere"))
    words = [
        "plan",
        ROOT / "configs/sample.yaml",
        "--workspace",
        finished,
        "--images",
        photos,
        "--json",
        *QUICK,
    ]
    assert set(actions(unshade(capsys, *words)[1]).values()) == {"reuse"}
    victim = sorted(photos.iterdir())[0]
    victim.write_bytes(victim.read_bytes() + b"\0")
    told = json.loads(unshade(capsys, *words)[1])
    assert told[0]["action"] == "run"
    assert told[0]["reason"] == f"input images changed ({victim.name} has other content)"


def test_a_flipped_byte_in_the_cache_is_noticed_and_rebuilt_to_the_same_bytes(own_copy, capsys):
    (mesh,) = (own_copy / "cache/mesh").glob("*/mesh.ply")
    before = mesh.read_bytes()
    mesh.write_bytes(before[:-9] + bytes([before[-9] ^ 1]) + before[-8:])
    words = [
        "run",
        ROOT / "configs/sample.yaml",
        "--workspace",
        own_copy,
        *QUICK,
        "--to",
        "raycast",
        "--json",
    ]
    code, told, _ = unshade(capsys, *words)
    assert code == 0
    assert actions(told) == {
        "sfm": "reuse",
        "undistort": "reuse",
        "mvs": "reuse",
        "mesh": "run",
        "refine": "reuse",
        "raycast": "reuse",
    }
    assert mesh.read_bytes() == before


def test_status_show_diff_and_clean_tell_what_is_there(own_copy, capsys):
    code, told, _ = unshade(capsys, "status", "--workspace", own_copy, "--json")
    assert code == 0
    assert {row["stage"] for row in json.loads(told)} >= {"sfm", "mvs", "decomposition"}
    code, told, _ = unshade(capsys, "show", "--workspace", own_copy, "--stage", "sfm", "--json")
    assert json.loads(told)["facts"]["registered"] == 12
    unshade(capsys, "run", ROOT / "configs/sample.yaml", "--workspace", own_copy, *QUICK, "--only", "export",
            "--set", "export.sheet_width_px=64")  # fmt: skip
    code, told, _ = unshade(capsys, "diff", "--workspace", own_copy, "--stage", "export", "--json")
    found = json.loads(told)
    assert found["made from"] == ["setting sheet_width_px went from 320 to 64"]
    assert any(line.startswith("contact_sheet") for line in found["outputs"])
    code, told, _ = unshade(capsys, "clean", "--workspace", own_copy, "--json")
    assert len(json.loads(told)["removed"]) == 1


def test_known_cameras_a_mesh_and_linear_images_need_no_sfm_and_no_mvs(tmp_path, capsys):
    code, told, _ = unshade(capsys, "run", *LINEAR, "--workspace", tmp_path / "w", "--json",
                            "--set", "raycast.reduce=3", "--set", "transfer.max_vertices=30000")  # fmt: skip
    assert code == 0
    assert list(actions(told)) == [
        "adopt_model", "undistort", "adopt_mesh", "raycast", "correspondence", "transfer", "lighting",
        "decomposition", "export", "report",
    ]  # fmt: skip
    (linear,) = (tmp_path / "w/cache/undistort").glob("*/linear")
    assert {path.stem for path in linear.iterdir()} == LINEAR_VIEWS
    for path in linear.iterdir():
        np.testing.assert_array_equal(read_exr(path), read_exr(SAMPLE / "linear/images" / path.name))


def test_masks_restrict_what_is_decomposed(tmp_path, capsys):
    from stages.formats.images.photos import photo_size, write_mask

    for path in (SAMPLE / "linear/images").glob("*.exr"):
        width, height = photo_size(path)
        left = np.zeros((height, width), bool)
        left[:, : width // 2] = True
        write_mask(tmp_path / "masks" / f"{path.stem}.png", left)
    words = ["run", *LINEAR, "--masks", tmp_path / "masks", "--workspace", tmp_path / "w", "--to", "raycast"]
    assert unshade(capsys, *words)[0] == 0
    written = sorted((tmp_path / "w/output/mask").iterdir())
    assert {path.stem for path in written} == LINEAR_VIEWS
    for path in written:
        mask = read_mask(path)
        assert mask.any()
        assert not mask[:, mask.shape[1] // 2 + 1 :].any()


def test_photos_that_are_white_all_over_are_said_to_be(tmp_path, capsys):
    """Four of them, developed far too bright: what comes out is a guess, and one has to know."""
    for path in sorted((SAMPLE / "photos").glob("*.jpg"))[:4]:
        white = np.full_like(read_photo(path), 1.0)
        write_png_srgb8(tmp_path / "photos" / f"{path.stem}.png", white)
    words = ["run", "--colmap", SAMPLE / "truth", "--images", tmp_path / "photos", "--mesh"]
    words += [SAMPLE / "truth/mesh.ply", "--workspace", tmp_path / "w"]
    for small in ("undistort.max_size_px=96", "transfer.max_vertices=1500", "transfer.sky_directions=64"):
        words += ["--set", small]
    code, _, said = unshade(capsys, *words)
    assert code == 0
    assert "pixels are white in a channel of their photo (from 98% on); expected few" in " ".join(
        said.split()
    )


def test_a_later_failure_keeps_earlier_results(own_copy, capsys):
    before = (own_copy / "output/contact_sheet.png").read_bytes()
    words = ["run", ROOT / "configs/sample.yaml", "--workspace", own_copy, *QUICK]
    code, _, said = unshade(capsys, *words, "--set", "raycast.views=[nobody]")
    assert code == 2
    assert "no view is called 'nobody'" in said
    assert (own_copy / "output/contact_sheet.png").read_bytes() == before
    assert unshade(capsys, *words)[0] == 0


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    """The current folder: photos, a configuration that names them but no workspace, nothing run yet."""
    (tmp_path / "statue").mkdir()
    (tmp_path / "statue/a.jpg").write_bytes(b"")
    (tmp_path / "job.yaml").write_text("sources: {images: statue}\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "photos", ["statue", "statue/images", "statue/photos", "statue/Input", "statue/images/JPG"]
)
def test_a_folder_whose_name_says_nothing_lends_the_name_above_it_to_the_workspace(photos, project):
    (project / photos).mkdir(parents=True, exist_ok=True)
    assert request_of(Plan(images=Path(photos))).workspace == Path("workspaces/statue")


def test_a_configuration_may_name_the_users_own_folder(project, monkeypatch):
    monkeypatch.setenv("HOME", str(project))
    (project / "job.yaml").write_text("workspace: ~/results\nsources: {images: ~/statue}\n")
    request = request_of(Plan(config=Path("job.yaml")))
    assert (request.workspace, request.sources["images"]) == (project / "results", project / "statue")


def test_the_version_is_said(capsys):
    assert unshade(capsys, "--version") == (0, f"unshade {version('unshade')}\n", "")


@pytest.mark.parametrize("words", [["--images", "statue"], ["job.yaml"], []])
def test_what_is_there_is_found_by_the_words_that_it_was_run_with_or_none(words, project, capsys):
    (project / "workspaces/statue/cache").mkdir(parents=True)
    assert unshade(capsys, "status", *words, "--json")[:2] == (0, "[]\n")


def test_of_several_workspaces_one_must_be_named(project, capsys):
    for name in ("statue", "gate"):
        (project / f"workspaces/{name}/cache").mkdir(parents=True)
    code, _, said = unshade(capsys, "status")
    assert code == 2
    assert "No workspace was named" in said
    assert "There are workspaces/gate, workspaces/statue." in said


@pytest.mark.parametrize("workspace", [None, ".", "results/first"])
def test_a_workspace_among_the_photos_is_refused_before_anything_is_written(
    workspace, tmp_path, monkeypatch, capsys
):
    photos = shutil.copytree(SAMPLE / "photos", tmp_path / "shoot")
    monkeypatch.chdir(photos)
    before = sorted(photos.iterdir())
    chosen = [] if workspace is None else ["--workspace", workspace]
    for verb in ("plan", "run"):
        code, _, said = unshade(capsys, verb, "--images", ".", *chosen)
        assert code == 2
        assert f"lies in {photos}, the folder of the source 'images'" in said
    assert sorted(photos.iterdir()) == before


def test_a_source_among_the_results_of_its_workspace_is_refused_and_left_as_it_is(tmp_path, capsys):
    """Its own result would have taken the place of a mesh that was mended there."""
    mended = tmp_path / "w/output/mesh.ply"
    mended.parent.mkdir(parents=True)
    mended.write_bytes(b"mended")
    words = ["--images", SAMPLE / "linear/images", "--colmap", SAMPLE / "linear", "--mesh", mended]
    code, _, said = unshade(capsys, "run", *words, "--workspace", tmp_path / "w")
    assert code == 2 and "lies among the results of the workspace" in said
    assert mended.read_bytes() == b"mended"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["run"], "No photos were given; expected --images DIR"),
        (["run", "nowhere.yaml"], "nowhere.yaml cannot be read"),
        (["run", "--images", "nowhere"], "--images nowhere does not exist"),
        (
            ["run", "--images", str(SAMPLE / "photos"), "--mesh", str(SAMPLE / "truth/mesh.ply")],
            "without --colmap",
        ),
        (["run", *LINEAR, "--set", "decomposition.lambada=1"], "did you mean 'lambda'?"),
        (["run", *LINEAR, "--set", "decomposition.neutrality=1"], "has moved to lighting.neutrality"),
        (["run", *LINEAR, "--set", "decomposition.lighting=shared"], "has moved to lighting.lights"),
        (["run", *LINEAR, "--set", "decomposition.bounces=0"], "has moved to lighting.bounces"),
        (["run", *LINEAR, "--set", "decomposition.lambda=-1"], "decomposition.lambda is -1"),
        (["run", *LINEAR, "--only", "meshes"], "There is no stage 'meshes'"),
        (["run", *LINEAR, "--only", "deliver"], "'deliver' in this dataflow; it is called 'export' now."),
        (["run", *LINEAR, "--set", "deliver.sheet_views=4"], "'deliver' to set; it is called 'export' now."),
        (
            ["run", *LINEAR, "--only", "raycast", "--to", "export"],
            "--only raycast and --to export were given",
        ),
        (
            ["plan", *LINEAR, "--only", "raycast", "--full-resolution"],
            "--full-resolution and --only raycast were given",
        ),
        (["plan", *LINEAR, "--to", "mesh", "--texture"], "--texture and --to mesh were given"),
        (["run", *LINEAR, "--threads", "0"], "--threads is 0"),
        (["status"], "No workspace was named"),
        (["show", "--workspace", "nowhere"], "holds no results yet"),
    ],
)
def test_a_mistake_gets_a_sentence_and_exit_code_2(words, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    code, _, said = unshade(capsys, *words)
    assert code == 2
    assert sentence in said
    assert "Traceback" not in said


def test_a_textured_model_is_made_on_demand_and_then_reused(own_copy, capsys):
    words = [ROOT / "configs/sample.yaml", "--workspace", own_copy, *QUICK, "--texture"]
    assert unshade(capsys, "run", *words, "--set", "texture.charts.most_faces=3000")[0] == 0
    model = trimesh.load(own_copy / "output/model/model.glb", force="mesh", process=False)
    assert 1000 < len(model.faces) <= 3000 and model.visual.material.baseColorTexture.size[0] >= 256
    code, told, _ = unshade(capsys, "plan", *words, "--set", "texture.charts.most_faces=3000", "--json")
    assert code == 0 and set(actions(told).values()) == {"reuse"}
    assert list(actions(told))[-3:] == ["full_resolution", "texture", "report"]
    assert min(view.encoded.psnr for view in rerendered([str(own_copy)])) > 20


def test_the_full_resolution_alone_may_be_asked_for(tmp_path, capsys):
    words = ["--workspace", tmp_path / "w", "--full-resolution", "--only", "full_resolution"]
    code, told, _ = unshade(capsys, "plan", *LINEAR, *words, "--json")
    assert code == 0
    assert list(actions(told))[-2:] == ["full_resolution", "report"]
    assert actions(told)["report"] == "leave"


def test_the_fountain_without_data_or_network_names_the_folder_to_fill(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("UNSHADE_DATA", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def unreachable(*args, **kwargs):
        raise OSError("no network")

    monkeypatch.setattr("pooch.retrieve", unreachable)
    code, _, said = unshade(capsys, "run", ROOT / "configs/fountain.yaml", "--workspace", tmp_path / "w")
    assert code == 2
    assert str(tmp_path / "fountain-P11") in said


def test_a_plan_of_data_that_are_not_here_fetches_nothing_and_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("UNSHADE_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("pooch.core.choose_downloader", pytest.fail)
    code, told, _ = unshade(capsys, "plan", ROOT / "configs/fountain.yaml", "--workspace", tmp_path / "w")
    assert code == 0
    assert "it has never run here; images, not on this machine, will be fetched" in told
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_data_with_a_wrong_checksum_is_refused(tmp_path, monkeypatch, capsys):
    (tmp_path / "fountain-P11/images").mkdir(parents=True)
    (tmp_path / "fountain-P11/images/0000.jpg").write_bytes(b"not the photo")
    monkeypatch.setenv("UNSHADE_DATA", str(tmp_path))
    code, _, said = unshade(capsys, "run", ROOT / "configs/fountain.yaml", "--workspace", tmp_path / "w")
    assert code == 2
    assert "0000.jpg has the checksum" in said


def outputs_of(workspace: Path) -> dict[str, dict]:
    """Digests of everything that every stage gave."""
    store = Store(workspace)
    return {stage: store.current(stage).outputs for stage in STAGES}


@pytest.mark.slow
def test_killed_during_every_stage_the_next_run_ends_with_the_same_digests(finished, tmp_path):
    workspace = tmp_path / "workspace"
    words = [sys.executable, "-m", "unshade", "run", str(ROOT / "configs/sample.yaml"), *QUICK]
    for stage in STAGES:
        victim = subprocess.Popen(
            [*words, "--workspace", str(workspace)], cwd=ROOT, stderr=subprocess.DEVNULL
        )
        deadline = time.monotonic() + 600
        while not list((workspace / "cache" / stage).glob(".partial-*")) and time.monotonic() < deadline:
            assert victim.poll() is None, f"it ended before {stage} began"
            time.sleep(0.005)
        victim.send_signal(signal.SIGKILL)
        victim.wait()
        assert not Store(workspace).records(stage), f"{stage} was published before it was killed"
    subprocess.run([*words, "--workspace", str(workspace)], cwd=ROOT, check=True)
    assert outputs_of(workspace) == outputs_of(finished)


@pytest.mark.slow
def test_one_thread_gives_the_same_bits_as_two(finished, tmp_path):
    words = ["run", str(ROOT / "configs/sample.yaml"), "--workspace", str(tmp_path / "w"), *QUICK]
    assert main([*words, "--threads", "1"]) == 0
    assert outputs_of(tmp_path / "w") == outputs_of(finished)
