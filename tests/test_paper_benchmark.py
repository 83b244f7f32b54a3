"""The paper's experiments, from render to report, too small to mean much; and the pieces that count."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.paper.__main__ import main
from benchmarks.paper.laboratory import FULL, QUARTER, Weights
from benchmarks.paper.rows import ROWS, TABLE_1


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    return main(["--tiny", "--rows", "fig3,fig5", "--workspace", str(folder)])


def test_every_row_and_method_has_its_numbers_and_its_picture(report):
    content = json.loads(report.with_name("paper.json").read_text(encoding="utf-8"))
    (size,) = content["sizes"]
    assert set(size["rows"]) == {"fig3", "fig5"}
    for name, methods in size["rows"].items():
        assert [method["method"] for method in methods] == [
            "the image itself",
            "cartoon-texture",
            "mode: paper",
            "mode: paper, solved well",
        ]
        for method in methods:
            assert all(0 < value < 1 for value in method["scores"]["si_rmse"].values())
        assert report.with_name(f"{name}-{size['size']}.png").stat().st_size > 1000
    page = report.read_text(encoding="utf-8")
    assert "| hair | red | 1.0000 | 0.0135 | 0.0274 |" in page
    first = page.split("### Table 2")[0].splitlines()
    assert not [line for line in first if "nan" in line and "too dark to count" not in line]


def test_solving_well_reaches_a_lower_energy_than_the_papers_rule(report):
    content = json.loads(report.with_name("paper.json").read_text(encoding="utf-8"))
    for methods in content["sizes"][0]["rows"].values():
        stopped, solved = (sum(c["energy"] for c in m["energies"].values()) for m in methods[2:])
        assert solved < stopped


def test_the_chosen_weights_are_the_best_of_the_sweep(report):
    sweep = json.loads(report.with_name("paper.json").read_text(encoding="utf-8"))["sweep"]
    errors = {one["settings"]: one["error"] for one in sweep["tried"]}
    assert len(errors) == 6
    assert errors[sweep["chosen"]] == min(errors.values())
    for one in sweep["tried"]:
        assert one["error"] == pytest.approx(np.mean(list(one["scores"]["si_rmse"].values())))


def test_weights_mean_the_same_at_every_size():
    assert Weights(12.0, 5.0).at(FULL) == {"lambda": 12.0, "mu": 5.0}
    assert Weights(12.0, 5.0).at(QUARTER) == {"lambda": 3.0, "mu": 5.0}


def test_the_rows_are_the_papers():
    assert [row.name for row in ROWS] == ["fig3", "fig4", "fig5", "fig6", "fig7"]
    assert {row.name for row in ROWS if row.lambda_factor == 1 / 12} == {"fig5", "fig6", "fig7"}
    assert TABLE_1["shirt"][2] == (0.0104, 0.0217)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """`make paper-quick`, renders included."""
    folder = tmp_path_factory.mktemp("quick")
    page = main(["--quick", "--workspace", str(folder), "--to", str(folder / "report")])
    return json.loads(page.with_name("paper.json").read_text(encoding="utf-8"))["sizes"][0]["rows"]


def red_variances(method) -> np.ndarray:
    """Of hair and face, as in the paper's tables."""
    cells = {(one["part"], one["channel"]): one["variance"] for one in method["scores"]["variances"]}
    return np.array([cells["hair", "red"], cells["face", "red"]])


@pytest.mark.slow
def test_in_every_row_the_papers_energy_beats_image_and_cartoon(quick):
    """Solved well, in both parts and in the error; the paper's own scheme, stopped early, beats the image.

    But for the face of Fig. 7: nine harmonics over smoothed geometry leave its dark side hardly any shading
    at this size, and the albedo there makes up for it (docs/paper: at the full size it holds).
    """
    assert list(quick) == [row.name for row in ROWS]
    for name, (image, cartoon, stopped, solved) in quick.items():
        parts = slice(0, 1) if name == "fig7" else slice(0, 2)
        best_of_rivals = np.minimum(red_variances(image), red_variances(cartoon))
        assert np.all((red_variances(solved) < best_of_rivals)[parts]), name
        assert np.all(red_variances(solved) < red_variances(image)), name
        assert np.all(red_variances(stopped) < red_variances(image)), name
        errors = [np.mean(list(one["scores"]["si_rmse"].values())) for one in (image, solved)]
        assert errors[1] < errors[0], name
        energies = [sum(c["energy"] for c in one["energies"].values()) for one in (stopped, solved)]
        assert energies[1] < energies[0], name
