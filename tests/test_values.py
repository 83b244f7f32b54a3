"""Values that are no light: masked, counted and said; whatever is written is numbers, and JSON is JSON."""

from __future__ import annotations

import ast
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline import json_text
from stages.cli import main
from stages.export import EXPORT
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.masked_photos import read_masked_photo
from stages.formats.images.photo_settings import FireflySettings
from stages.formats.images.photos import write_png_srgb8
from tests.raw_exr import write_raw_exr

ROOT = Path(__file__).parent.parent
SAMPLE = ROOT / "sample_data"
VIEWS = sorted(path.stem for path in (SAMPLE / "linear/images").glob("*.exr"))
SMALL = ["undistort.max_size_px=64", "transfer.max_vertices=800", "transfer.sky_directions=32",
         "transfer.directions=16"]  # fmt: skip
MASKED = 1000.0


def no_constant(name: str) -> None:
    raise AssertionError(f"{name} is not JSON")


def strictly(text: str) -> object:
    return json.loads(text, parse_constant=no_constant)


def run(folder: Path, capsys) -> tuple[int, str, str]:
    words = ["run", "--colmap", SAMPLE / "linear", "--images", folder / "images", "--workspace", folder / "w"]
    words += ["--mesh", SAMPLE / "truth/mesh.ply", "--json"]
    for one in SMALL:
        words += ["--set", one]
    code = main([str(word) for word in words])
    return code, *capsys.readouterr()


def check_outputs(folder: Path) -> None:
    """Every map finite, every JSON JSON."""
    maps = sorted((folder / "w/output").rglob("*.exr"))
    assert {path.parent.name for path in maps} >= {"albedo", "shading", "albedo_tv", "confidence"}
    for path in maps:
        assert np.isfinite(read_exr(path)).all(), path
    texts = [path for path in (folder / "w").rglob("*.json") if path.name != "digests.json"]
    assert len(texts) > 10
    for path in texts:
        strictly(path.read_text(encoding="utf-8"))


def write_views(folder: Path, change) -> None:
    for view in VIEWS:
        image = read_exr(SAMPLE / "linear/images" / f"{view}.exr")
        write_raw_exr(folder / "images" / f"{view}.exr", change(view, image.copy()))


def object_pixels(image: np.ndarray) -> np.ndarray:
    return np.argwhere(image.mean(axis=2) > np.median(image))


def test_one_pixel_beyond_all_light_does_not_reach_the_albedo(tmp_path, capsys):
    """Once it made all albedo of all views NaN, with exit code 0."""

    def spiked(view: str, image: np.ndarray) -> np.ndarray:
        if view == VIEWS[0]:
            row, column = object_pixels(image)[500]
            image[row, column] = 3e38
        return image

    write_views(tmp_path, spiked)
    code, out, said = run(tmp_path, capsys)
    assert code == 0, said
    strictly(out)
    check_outputs(tmp_path)
    assert f"1 pixels of {VIEWS[0]}.exr are masked" in " ".join(said.split())
    (record,) = (tmp_path / "w/cache/undistort").glob("*/record.json")
    assert strictly(record.read_text())["facts"]["impossible_pixels"] == {f"{VIEWS[0]}.exr": 1}


def test_one_per_cent_of_fireflies_is_masked_and_the_pictures_are_not_black(tmp_path, capsys):
    rng = np.random.default_rng(0)

    def sprinkled(view: str, image: np.ndarray) -> np.ndarray:
        image[rng.random(image.shape[:2]) < 0.01] = 1e4
        return image

    write_views(tmp_path, sprinkled)
    code, _, said = run(tmp_path, capsys)
    assert code == 0, said
    check_outputs(tmp_path)
    assert "are masked: they are not numbers, or more than 1000 times as bright" in " ".join(said.split())
    white = strictly((tmp_path / "w/output/png_scale.json").read_text())["png_white"]["albedo"]
    assert white < 10


@pytest.mark.parametrize("scale", [1e-30, 1e25])
def test_light_in_any_unit_gives_albedo_in_it(tmp_path, capsys, scale):
    write_views(tmp_path, lambda view, image: image * np.float32(scale))
    code, _, said = run(tmp_path, capsys)
    assert code == 0, said
    check_outputs(tmp_path)
    albedo = read_exr(tmp_path / f"w/output/albedo/{VIEWS[0]}.exr")
    assert 0.01 * scale < np.median(albedo[albedo > 0]) < 10 * scale


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    exponent=st.floats(-30, 25),
    spikes=st.lists(st.floats(width=32, allow_nan=True, allow_infinity=True), max_size=4),
)
def test_a_photo_is_read_finite_and_loses_only_what_is_no_light(tmp_path, exponent, spikes):
    rng = np.random.default_rng(1)
    image = (rng.uniform(0.1, 1, (20, 30, 3)) * 10**exponent).astype(np.float32)
    image[0, : len(spikes), 1] = spikes
    write_raw_exr(tmp_path / "a.exr", image)
    linear, kept, impossible = read_masked_photo(
        tmp_path / "a.exr", None, (30, 20), False, True, MASKED, FireflySettings()
    )
    assert np.isfinite(linear).all()
    assert np.square(linear.astype(np.float64)).sum() < np.inf
    wild = ~(np.abs(np.float64(spikes)) <= 2 * MASKED * 10**exponent)  # where its bound is, 3 % say
    assert impossible == np.count_nonzero(~kept) >= np.count_nonzero(wild)
    assert kept[1:].all() and kept[0, len(spikes) :].all()


@pytest.mark.parametrize("side", [4, 6, 10, 20])
def test_a_small_bright_thing_before_a_dark_wall_is_kept(tmp_path, side):
    """Less than a hundredth of the photo, or more, ten thousand times as bright as the rest."""
    image = np.full((40, 50, 3), 1e-4, np.float32)
    image[5 : 5 + side, 7 : 7 + side] = 1
    write_exr(tmp_path / "a.exr", image)
    _, kept, impossible = read_masked_photo(
        tmp_path / "a.exr", None, (50, 40), False, True, MASKED, FireflySettings()
    )
    assert kept.all() and impossible == 0


def test_photos_of_eight_bits_hold_nothing_absurd(tmp_path):
    image = np.full((40, 50, 3), 1e-4, np.float32)
    image[3, 4] = 1
    write_png_srgb8(tmp_path / "a.png", image)
    _, kept, impossible = read_masked_photo(
        tmp_path / "a.png", None, (50, 40), False, True, MASKED, FireflySettings()
    )
    assert kept.all() and impossible == 0


def test_photos_without_any_light_are_said_to_be(tmp_path, capsys):
    write_views(tmp_path, lambda view, image: image * np.float32(np.nan))
    code, _, said = run(tmp_path, capsys)
    assert code == 2
    assert "holds a value that can be light" in " ".join(said.split())


def test_values_that_are_no_numbers_are_not_written(tmp_path):
    with pytest.raises(ValueError, match=r"1 values of a\.exr are not finite"):
        write_exr(tmp_path / "a.exr", np.array([[1, np.nan]]))
    with pytest.raises(ValueError, match="not finite"):
        write_exr(tmp_path / "a.exr", np.array([[1, 1e6]]), half=True)
    assert not (tmp_path / "a.exr").exists()


def test_pictures_that_come_out_dark_are_said_to(tmp_path, make_job, capsys):
    """One per cent of the albedo far above the rest, as of a lamp: white is lost to it."""
    write_views(tmp_path, lambda view, image: image)
    code, _, said = run(tmp_path, capsys)
    assert code == 0 and "look black" not in said
    cache = tmp_path / "w/cache"
    places = {name: next(cache.glob(f"*/*/{name}")) for name in EXPORT.takes if name != "cameras"}
    places["cameras"] = next(cache.glob("raycast/*/cameras.json"))
    shutil.copytree(places["albedo"], tmp_path / "albedo")
    for view in VIEWS:
        albedo = read_exr(tmp_path / f"albedo/{view}.exr")
        albedo[tuple(np.argwhere(albedo.min(axis=2) > 0)[::100].T)] = 1e5
        write_exr(tmp_path / f"albedo/{view}.exr", albedo)
    job = make_job(tmp_path / "out", EXPORT, **places | {"albedo": tmp_path / "albedo"})
    EXPORT.run(job)
    assert [warning[:24] for warning in job.warnings] == ["The PNGs of albedo look "]
    assert "Lower export.white_quantile (0.995)" in job.warnings[0]


def test_json_has_no_word_for_what_is_no_number():
    text = json_text({"a": [float("nan"), 1.5, float("inf")], "ü": (float("-inf"), None, True)}, indent=1)
    assert strictly(text) == {"a": [None, 1.5, None], "ü": [None, None, True]}


def test_all_json_is_written_by_one_function():
    allowed = {
        ROOT / "pipeline/files/json_text.py",
        ROOT / "pipeline/cache/digest.py",
        ROOT / "pipeline/config.py",
    }
    for folder in ("pipeline", "stages"):
        for path in {*(ROOT / folder).rglob("*.py")} - allowed:
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                    assert (node.value.id, node.attr) not in {("json", "dumps"), ("json", "dump")}, path
