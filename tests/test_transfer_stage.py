"""`mode: transfer` on the command line: what it takes and refuses, and that it beats the paper's light."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from stages.cli import main
from stages.formats.artefacts.transfer_file import read_transfer
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask
from stages.lighting import _probes
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.transport.directional_transport import Sphere, even_directions
from tests.rendered_scene import TINY, artefact, unshade, write_config

DOME = TINY | {"views": 4, "width_px": 54, "height_px": 96, "arc_deg": 90.0, "noise": 0.03, "spacing": 0.02}
TRANSFER = {"directions": 64, "degree": 3}
BY_TRANSFER = {"mode": "transfer"}
HARMONICS = ["--set", "decomposition.light=harmonics", "--set", "decomposition.lambda=1"]
NAMES = ["000", "001", "002", "003"]


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> Path:
    """A bust under the sky dome, with bounces; not to be changed by a test."""
    path = write_config(
        tmp_path_factory.mktemp("dome") / "dome.yaml",
        render=DOME,
        transfer=TRANSFER,
        decomposition=BY_TRANSFER,
    )
    assert main(["run", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def output(config) -> Path:
    return config.parent / "w/output"


def errors(output: Path, capsys) -> np.ndarray:
    capsys.readouterr()  # where the run that came before says that its results are
    code, told, said = unshade(capsys, "evaluate", output / "albedo", output / "truth", "--json")
    assert code == 0, said
    return np.array(list(json.loads(told)["si_rmse"].values()))


def test_albedo_times_shading_is_the_image_and_the_light_says_what_it_meets(config, output):
    lighting = json.loads((output / "lighting.json").read_text(encoding="utf-8"))
    assert "sum over the directions" in lighting["convention"]
    assert lighting["distance"] is None
    count = len(lighting["directions"])
    assert np.shape(lighting["radiance"]) == (1, count, 3)
    assert count >= 256 and (count - 256) % 6 == 0
    assert np.sum(lighting["cells"]) == pytest.approx(1, abs=1e-5)
    assert np.min(lighting["radiance"]) >= 0
    assert {view["light"] for view in lighting["views"]} == {0}
    for name in NAMES:
        linear = read_exr(artefact(config.parent / "w", "undistort", "linear") / f"{name}.exr")
        mask = read_mask(output / f"mask/{name}.png")
        albedo, shading = (read_exr(output / f"{what}/{name}.exr") for what in ("albedo", "shading"))
        off = np.abs(albedo * shading - linear)[mask].mean() / linear[mask].mean()
        assert off < 0.15


def test_who_looks_again_sees_what_is_stored(config, output):
    """The eyes that `lighting` makes of the file, in the directions that the file was made in."""
    stored = read_transfer(artefact(config.parent / "w", "transfer", "transfer.npz"))
    probes = _probes(SimpleNamespace(threads=1, executor=None, settings=LightingSettings()), stored)
    directions = even_directions(int(stored.directions))
    assert stored.radii.size == 3
    for radius, visible in zip(stored.radii, stored.visible, strict=True):
        sphere = Sphere(tuple(stored.centre), radius) if np.isfinite(radius) else None
        assert np.array_equal(probes.see(directions, sphere), visible)


def test_light_and_albedo_are_the_same_bytes_on_any_number_of_threads(config, capsys):
    for stage in ("lighting", "decomposition"):
        code, _, said = unshade(capsys, "run", config, "--only", stage, "--force", "--threads", "1")
        assert code == 0, said
        assert "came out different" not in said.replace("\n", " ")


def test_what_only_this_mode_knows_is_there(output):
    assert sorted(path.name for path in (output / "environment").iterdir()) == ["shared.exr", "shared.png"]
    assert read_exr(output / "environment/shared.exr").min() >= 0
    for name in NAMES:
        mask = read_mask(output / f"mask/{name}.png")
        known = read_exr(output / f"confidence/{name}.exr")
        assert known[~mask].max() == 0
        assert 0 <= known.min() < known.max() < 1
        smooth, detailed = (read_exr(output / f"{kind}/{name}.exr") for kind in ("albedo_tv", "albedo"))
        assert smooth.shape == detailed.shape
        assert min(smooth.min(), detailed.min()) >= 0


def test_harmonic_light_meets_transfer_vectors(config, output):
    assert main(["run", str(config), *HARMONICS]) == 0
    lighting = json.loads((output / "lighting.json").read_text(encoding="utf-8"))
    assert "transfer vector of the point" in lighting["convention"]
    assert np.shape(lighting["views"][0]["red"]) == (16,)
    assert len(list((output / "environment").glob("*.exr"))) == len(NAMES)
    name = NAMES[0]
    known, mask = read_exr(output / f"confidence/{name}.exr"), read_mask(output / f"mask/{name}.png")
    assert (known[mask] > 0).mean() > 0.95, "all data count in Eq. 2"
    assert main(["run", str(config)]) == 0


def test_light_that_sees_the_mouth_leaves_less_of_it_in_the_albedo(config, output, capsys):
    """Than the paper's energy does, solved well, under the paper's light: less than half, on the whole."""
    by_transfer = errors(output, capsys)
    settings = ["--set", "decomposition.mode=paper", "--set", "decomposition.solver=fast"]
    assert main(["run", str(config), "--workspace", str(config.parent / "w"), *settings]) == 0
    by_normals = errors(output, capsys)
    left = {"environment", "albedo_tv", "confidence"} & {path.name for path in output.iterdir()}
    assert not left, "they are of another light"
    assert main(["run", str(config)]) == 0
    assert np.all(by_transfer < 0.8 * by_normals), (by_transfer, by_normals)
    assert by_transfer.mean() < 0.5 * by_normals.mean()
    assert np.array_equal(errors(output, capsys), by_transfer)


def test_a_setting_of_one_kind_of_light_runs_nothing_under_another(config, capsys):
    paper = ["--set", "decomposition.mode=paper", "--set", "decomposition.solver=fast"]
    code, _, said = unshade(capsys, "run", config, *paper)
    assert code == 0, said
    for setting in ("edges.coarse_lambda=5", "harmonics.refreshes=1", "bounces=2"):
        changed = ["--set", f"decomposition.{setting}"]
        code, told, said = unshade(capsys, "plan", config, *paper, *changed, "--json")
        assert code == 0, said
        assert {row["action"] for row in json.loads(told)} == {"reuse"}, setting
    assert main(["run", str(config)]) == 0


def test_only_mode_transfer_knows_the_stage(config, capsys):
    _, told, _ = unshade(capsys, "plan", config)
    assert "\ntransfer " in told
    code, told, _ = unshade(capsys, "plan", config, "--set", "decomposition.mode=paper")
    assert code == 0
    assert "\ntransfer " not in told and "\nlighting " not in told
    code, told, _ = unshade(capsys, "plan", config, *HARMONICS)
    assert code == 0
    assert "\ntransfer " in told and "\nlighting " not in told


def test_what_does_not_go_together_is_said(config, capsys):
    """Before anything runs: a plan refuses it already."""
    code, _, said = unshade(capsys, "plan", config, "--set", "decomposition.solver=paper")
    assert code == 2
    assert "the paper's solver knows the paper's light only" in said.replace("\n", " ")
    code, _, said = unshade(capsys, "plan", config, "--set", "transfer.light_distances=[8, 1]")
    assert code == 2
    assert "transfer.light_distances.1 is 1; expected greater than or equal to 1.5" in said.replace("\n", " ")
    code, _, said = unshade(capsys, "plan", config, *HARMONICS, "--set", "decomposition.degree=4")
    assert code == 2
    assert "decomposition.degree is 4, but the transfer vectors end at 3" in said.replace("\n", " ")
    assert unshade(capsys, "plan", config, "--set", "decomposition.degree=4")[0] == 0  # nobody asks for it


def test_a_decimated_mesh_gives_nearly_the_same_albedo(config, output):
    before = [read_exr(output / f"albedo/{name}.exr") for name in NAMES]
    assert main(["run", str(config), "--set", "transfer.max_vertices=1500"]) == 0
    stored = read_transfer(artefact(config.parent / "w", "transfer", "transfer.npz"))
    assert len(stored.blocked) < 2000 < len(stored.corners)
    assert np.allclose(stored.weights.sum(axis=1), 1, atol=1e-5)
    after = [read_exr(output / f"albedo/{name}.exr") for name in NAMES]
    assert main(["run", str(config)]) == 0
    away = np.sqrt(np.mean([np.mean((a - b) ** 2) for a, b in zip(after, before, strict=True)]))
    assert away < 0.1 * np.sqrt(np.mean([np.mean(b**2) for b in before]))
