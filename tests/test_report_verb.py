"""`unshade report`: the page anew from what is there, and what it says where nothing is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stages.cli import main

LINEAR = Path(__file__).parent.parent / "sample_data/linear"
GIVEN = ["--colmap", str(LINEAR), "--images", str(LINEAR / "images")]
GIVEN += ["--mesh", str(LINEAR.parent / "truth/mesh.ply"), "--set", "raycast.reduce=4"]


@pytest.fixture(scope="module")
def halfway(tmp_path_factory) -> Path:
    """A run that ended before there was any light."""
    workspace = tmp_path_factory.mktemp("halfway") / "workspace"
    assert main(["run", *GIVEN, "--workspace", str(workspace), "--to", "correspondence"]) == 0
    return workspace


def test_a_run_that_stopped_half_way_is_shown_as_far_as_it_went(halfway, capsys):
    assert not (halfway / "output/report.html").exists()
    capsys.readouterr()
    assert main(["report", *GIVEN, "--workspace", str(halfway), "--json"]) == 0
    told = capsys.readouterr()
    written = json.loads(told.out)["written"]
    assert [Path(path).name for path in written] == ["report.html", "report.json"]
    assert "mvs" not in told.err  # no stage but the report
    report = json.loads((halfway / "output/report.json").read_text(encoding="utf-8"))
    assert report["verdict"][0] == "The cameras were given: 4 views."
    assert report["verdict"][2] == "There is no albedo yet."
    assert {kind for view in report["views"] for kind in view["kinds"]} == {"photo", "normal", "depth"}
    assert list(report["records"]) == [
        "adopt_model", "undistort", "adopt_mesh", "raycast", "correspondence", "report",
    ]  # fmt: skip


def test_the_same_report_again_is_reused_and_left_as_it_is(halfway, capsys):
    assert main(["report", *GIVEN, "--workspace", str(halfway)]) == 0
    page = halfway / "output/report.html"
    before = page.stat().st_mtime_ns
    capsys.readouterr()
    assert main(["report", *GIVEN, "--workspace", str(halfway)]) == 0
    assert "reuse" in capsys.readouterr().err
    assert page.stat().st_mtime_ns == before


def test_without_views_it_says_what_makes_them(tmp_path, capsys):
    assert main(["report", *GIVEN, "--workspace", str(tmp_path / "nothing")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "holds no views that belong together yet (cameras and linear missing)" in said
    assert "`unshade run` makes them" in said
    assert not (tmp_path / "nothing").exists()
