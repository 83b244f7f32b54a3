"""`unshade compare`: one scale is taken out, the rest is the difference; the page says what differs."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from dataclasses import replace
from html import unescape
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.cache.record import Record, write_record
from pipeline.cache.store import Store
from pipeline.inspect import connected_results
from stages.cli import main
from stages.formats.artefacts.camera_file import read_cameras, write_cameras
from stages.formats.images.exr import read_exr, write_exr
from stages.reporting.comparison.paired_views import (
    Side,
    difference_of,
    paired_pictures,
    ratio_of,
    sampled_albedos,
    shift_px,
)
from stages.reporting.comparison.remarks import remarks
from stages.reporting.settings import ComparisonSettings, PictureSettings
from tests.reported_scene import NAMES, written_scene

HOW, LARGEST = ComparisonSettings(), 1280
SCALE = np.array([2.0, 0.5, 1.25], np.float32)
ARTEFACTS = {  # by stage, of a workspace that is written here: name and path
    "undistort": {"linear": "linear"},
    "raycast": {"cameras": "cameras.json", "mask": "mask"},
    "decomposition": {"albedo": "albedo", "shading": "shading", "confidence": "confidence"},
    "export": {"scales": "png_scale.json"},
}
TAKEN = {"raycast": ["linear"], "decomposition": ["cameras", "mask"], "export": ["albedo"]}


def side_of(places: dict[str, Path]) -> Side:
    return Side({camera.name: camera for camera in read_cameras(places["cameras"])}, places)


def with_albedo(places: dict[str, Path], folder: Path, change) -> dict[str, Path]:
    """The same result with other albedos: ``change(number, albedo)``."""
    for number, name in enumerate(NAMES):
        write_exr(folder / f"{name}.exr", change(number, read_exr(places["albedo"] / f"{name}.exr")))
    return places | {"albedo": folder}


@pytest.fixture(scope="module")
def places(tmp_path_factory) -> dict[str, Path]:
    return written_scene(tmp_path_factory.mktemp("a"))


def compared(a: Side, b: Side):
    """Scale and difference of all views."""
    samples = [sampled_albedos(a, b, name, LARGEST, HOW.pixels) for name in a.cameras]
    ratio = ratio_of(samples, HOW)
    return ratio, difference_of(samples, ratio)


def test_albedos_that_differ_by_a_factor_per_channel_do_not_differ(places, tmp_path):
    other = with_albedo(places, tmp_path, lambda _, albedo: albedo * SCALE)
    ratio, difference = compared(side_of(places), side_of(other))
    assert ratio.scale == pytest.approx(SCALE, rel=1e-5)
    assert difference == pytest.approx([0, 0, 0], abs=1e-5)
    assert ratio.stops == HOW.least_stops


def test_the_difference_is_orange_where_b_is_brighter_blue_where_it_is_darker_and_grey_elsewhere(
    places, tmp_path
):
    def change(number: int, albedo: np.ndarray) -> np.ndarray:
        albedo = albedo * SCALE
        albedo[40:45, 40:45] *= 1.5
        albedo[50:55, 50:55] /= 1.5
        return albedo

    a, b = side_of(places), side_of(with_albedo(places, tmp_path, change))
    ratio, difference = compared(a, b)
    assert ratio.scale == pytest.approx(SCALE, rel=1e-5)
    assert 0 < min(difference) < max(difference) < 0.1
    picture, visible = paired_pictures(a, b, NAMES[0], LARGEST, ratio, PictureSettings())["difference"]
    brighter, darker, same = picture[42, 42].astype(int), picture[52, 52].astype(int), picture[60, 48]
    assert brighter[0] > 200 > 100 > brighter[2]
    assert darker[2] > 150 > 100 > darker[0]
    assert np.abs(same.astype(int) - 128).max() <= 2
    assert visible[42, 42]
    assert not visible[0, 0]


def test_albedo_and_shading_of_b_are_shown_on_the_scale_of_a(places, tmp_path):
    other = with_albedo(places, tmp_path / "albedo", lambda _, albedo: albedo * SCALE)
    for name in NAMES:
        write_exr(tmp_path / f"s/{name}.exr", read_exr(places["shading"] / f"{name}.exr") / SCALE)
    a, b = side_of(places), side_of(other | {"shading": tmp_path / "s"})
    pictures = paired_pictures(a, b, NAMES[0], LARGEST, compared(a, b)[0], PictureSettings())
    for kind in ("albedo", "shading", "confidence"):
        first, second = (pictures[f"{kind} {label}"][0].astype(int) for label in "AB")
        assert np.abs(first - second).max() <= 1, kind
        assert first.max() > 100, kind


def test_results_of_two_sizes_are_compared_at_the_smaller_one_and_it_is_said(places, tmp_path):
    a, b = side_of(places), side_of(written_scene(tmp_path, side=48))
    ratio, difference = compared(a, b)
    assert ratio.scale == pytest.approx(np.ones(3), rel=0.02)
    assert max(difference) < 0.05
    shapes = {
        one.shape[:2]
        for one, _ in paired_pictures(a, b, NAMES[0], LARGEST, ratio, PictureSettings()).values()
    }
    assert shapes == {(48, 48)}
    (said,) = remarks(a, b, list(NAMES), difference, HOW.most_shift_px)
    assert "A 96×96, B 48×48 pixels" in said


def test_lenses_that_differ_by_more_than_half_a_pixel_are_named(places):
    a = side_of(places)
    camera = a.cameras[NAMES[0]]
    moved = replace(camera, intrinsics=camera.intrinsics + np.array([[0, 0, 3.0], [0, 0, 0], [0, 0, 0]]))
    b = Side({**a.cameras, NAMES[0]: moved}, a.places)
    assert shift_px(a, Side({NAMES[0]: camera.scaled(48, 48)}, a.places), NAMES[0]) == pytest.approx(
        0, abs=1e-9
    )
    assert shift_px(a, b, NAMES[0]) == pytest.approx(3)
    (said,) = remarks(a, b, list(NAMES), [0, 0, 0], HOW.most_shift_px)
    assert "3.0 pixels apart" in said


def test_without_a_common_pixel_nothing_is_scaled_and_it_is_said(places, tmp_path):
    a, b = side_of(places), side_of(with_albedo(places, tmp_path, lambda _, albedo: 0 * albedo))
    ratio, difference = compared(a, b)
    assert ratio.scale.tolist() == [1, 1, 1]
    assert difference is None
    assert "no pixel of surface in common" in remarks(a, b, list(NAMES), None, HOW.most_shift_px)[-1]


def workspace_of(folder: Path, places: dict[str, Path], mark: str = "", **of_stage) -> Path:
    """A workspace with these artefacts as results of stages, made from one another."""
    store = Store(folder)
    outputs: dict[str, dict[str, str]] = {}
    for stage, own in ARTEFACTS.items():
        key = f"{len(outputs):x}" * 32
        entry = store.entry(stage, key)
        entry.mkdir(parents=True)
        for name, path in own.items():
            (entry / path).symlink_to(places[name])
        empty = {name: {} for name in ("settings", "tools", "machine")}
        values = empty | {"seconds": 2.0, "peak_bytes": 10**8} | of_stage.get(stage, {})
        inputs = {name: outputs[name] for name in TAKEN.get(stage, ())} or {"images": {"a.jpg": "1"}}
        given = {name: {"file": f"{stage}{mark}"} for name in own}
        write_record(entry, Record(stage, 1, key, inputs=inputs, outputs=given, **values))
        store.set_current(stage, key)
        outputs |= given
    return folder


@pytest.fixture
def two(tmp_path, places) -> tuple[Path, Path]:
    """Two workspaces: of one, albedos are twice those of the other, and a view is missing."""
    fewer = tmp_path / "cameras.json"
    write_cameras(fewer, read_cameras(places["cameras"])[1:])
    other = with_albedo(places, tmp_path / "albedo", lambda _, albedo: 2 * albedo) | {"cameras": fewer}
    settings = {"decomposition": {"settings": {"mode": "<paper>", "lambda": 2.0}}}
    of_a = {"decomposition": {"settings": {"lambda": 3.0}}}
    return workspace_of(tmp_path / "a", places, **of_a), workspace_of(tmp_path / "b", other, "2", **settings)


def test_the_page_of_two_workspaces_has_all_views_and_asks_for_nothing(two, tmp_path, capsys):
    page = tmp_path / "page.html"
    assert main(["compare", *map(str, two), "--output", str(page), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["scale"] == pytest.approx([2, 2, 2], rel=1e-4)
    assert max(told["difference"]) < 1e-3
    assert told["only_in_a"] == [NAMES[0]]
    assert told["settings"] == [["decomposition.lambda", "3", "2"]]
    assert told["settings_of_one"] == [["decomposition.mode", "–", "<paper>"]]
    text = page.read_text(encoding="utf-8")
    assert "default-src 'none'" in unescape(text)
    assert not re.search(r"(?:src|href)=\"(?!data:|#)", text)
    assert "&lt;paper&gt;" in text
    assert "<paper>" not in text
    data = json.loads(re.search(r'id="data">(.*?)</script>', text)[1])
    assert [view["name"] for view in data["views"]] == list(NAMES[1:])
    assert set(data["views"][0]["pictures"]) == set(data["kinds"])
    picture = data["views"][0]["pictures"]["difference"].split(",")[1]
    assert Image.open(BytesIO(b64decode(picture))).size == (96, 96)


def test_a_result_of_another_albedo_is_not_shown_beside_this_one(two):
    a, _ = two
    store = Store(a)
    assert set(connected_results(store, "decomposition")) == set(ARTEFACTS)
    export = store.current("export")
    stale = replace(export, key="e" * 32, inputs={"albedo": {"file": "of another run"}})
    store.entry("export", stale.key).mkdir()
    write_record(store.entry("export", stale.key), stale)
    store.set_current("export", stale.key)
    assert set(connected_results(store, "decomposition")) == set(ARTEFACTS) - {"export"}


def test_a_workspace_without_albedo_or_results_is_answered_in_a_sentence(two, tmp_path, capsys):
    a, b = two
    (tmp_path / "empty").mkdir()
    config = tmp_path / "new.yaml"
    sample = Path(__file__).parent.parent / "sample_data/linear"
    config.write_text(f"sources: {{colmap: {sample}, images: {sample / 'images'}}}\nworkspace: new\n")
    for words, told in (
        ([a, tmp_path / "empty"], "B is the folder"),
        ([a, config], "has no albedo of these settings"),
        ([a, b, "--set-b", "decomposition.mode=paper"], "--set-b was given"),
        ([a, b, "--output", tmp_path / "photo.jpg"], "expected a file named like comparison.html"),
        ([a, tmp_path / "nowhere"], "nowhere"),
    ):
        assert main(["compare", *map(str, words)]) == 2
        assert told in " ".join(capsys.readouterr().err.split())
    (b / "cache/current.json").unlink()
    assert main(["compare", str(a), str(b)]) == 2
    assert "has no albedo yet; `unshade run` makes it" in " ".join(capsys.readouterr().err.split())
