"""`benchmarks.accuracy`, from render to report, too small to mean much."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.accuracy import touched
from benchmarks.accuracy.__main__ import main
from benchmarks.accuracy.on_a_floor import write_on_a_floor
from benchmarks.accuracy.relighting import in_another_light
from benchmarks.accuracy.report import light_distance, worst_variance
from benchmarks.accuracy.scenes import paper_rows
from benchmarks.paper.laboratory import TINY
from stages.evaluation.part_variance import part_variances
from stages.photometry.environment import directions_of_picture
from stages.scene.exr import write_exr
from stages.scene.meshes import read_mesh, read_vertex_colours, write_mesh
from tests.bowls import bowl
from tests.judged_scene import PARTS, predicted, truth_views


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("accuracy")
    to = ["--workspace", str(folder), "--to", str(folder / "report")]
    return main(["--tiny", "--rows", "fig3,fig5", *to])


def test_every_method_is_judged_on_every_row_and_shown(report):
    numbers = json.loads(report.with_name("accuracy.json").read_text(encoding="utf-8"))
    assert set(numbers) == {"fig3", "fig5"}
    page = report.read_text(encoding="utf-8")
    for name, methods in numbers.items():
        assert len(methods) == 5
        assert report.with_name(f"{name}.png").stat().st_size > 1000
        assert f"({name}.png)" in page
        for method in methods:
            assert f"| {method} |" in page


def test_ours_is_nearer_to_the_truth_than_image_and_paper_even_at_this_size(report):
    numbers = json.loads(report.with_name("accuracy.json").read_text(encoding="utf-8"))
    for methods in numbers.values():
        error = {name: np.array(list(one["scores"]["si_rmse"].values())) for name, one in methods.items()}
        assert np.all(error["mode: transfer"] < error["the image itself"])
        assert error["mode: transfer"].mean() < 0.8 * error["mode: paper"].mean()


def test_detail_is_said_per_octave_as_the_json_has_it(report):
    numbers = json.loads(report.with_name("accuracy.json").read_text(encoding="utf-8"))
    page = report.read_text(encoding="utf-8")
    sections = {line.split("\n")[0]: line for line in page.split("\n## ")[1:]}
    for measure in ("error", "gain"):
        section = next(text for head, text in sections.items() if head.startswith(f"Detail: {measure}"))
        for name, methods in numbers.items():
            row = next(line for line in section.splitlines() if line.startswith(f"| {name} "))
            for cell, method in zip(row.split("|")[2:-1], methods.values(), strict=True):
                values = [octave[f"brightness_{measure}"] for octave in method["scores"]["detail"]]
                assert cell.split() == ["–" if value is None else f"{value:.2f}" for value in values]
    assert "(σ 1–2, 2–4, 4–8, 8–16, 16–32 px)" in page


def test_views_relit_from_the_albedo_are_nearer_to_the_truth_than_from_the_photos(report, tmp_path):
    light = tmp_path / "sunset.exr"
    sun = np.maximum(directions_of_picture(16) @ [0.0, -1.0, 0.0], 0)[..., None]
    write_exr(light, (0.2 + sun * [3, 2, 1]).astype(np.float32))
    relit = in_another_light(*paper_rows(TINY)[2], light, report.parent.parent)
    assert relit.from_albedo > relit.from_photos + 3
    assert relit.picture.dtype == np.uint8
    assert relit.picture.std() > 10


def test_variances_that_are_not_known_are_counted_and_hide_no_worst_ratio():
    """One that is not known must not be the largest, wherever it stands; one channel of three is too dark."""
    rng = np.random.default_rng(1)
    noise = [rng.standard_normal((*view.judged.shape, 1)) for view in truth_views()]
    ours = part_variances(predicted(lambda view, i: view.truth * (1 + 0.2 * noise[i])), PARTS)
    paper = part_variances(predicted(lambda view, i: view.truth * (1 + 0.1 * noise[i])), PARTS)
    black = part_variances(predicted(lambda view, i: 0 * view.truth), PARTS)
    known = worst_variance(ours[3:], paper[3:])
    assert known.startswith("4.0")
    assert worst_variance((*black[:3], *ours[3:]), paper) == f"{known}, 2 unknown"
    assert worst_variance(paper, part_variances(truth_views(), PARTS)) == "–"


def test_the_light_s_distance_is_said_in_radii_of_whatever_scene_it_is():
    left = {"inf": 0.2, "39.48": 0.1, "19.74": 0.12}
    assert light_distance({"light_distance": 39.48, "disagreement": left}) == "8 radii"
    assert light_distance({"light_distance": 19.74, "disagreement": left}) == "4 radii"
    assert light_distance({"light_distance": "infinitely far", "disagreement": left}) == "infinitely far"


def test_a_row_that_is_not_there_is_refused_by_name(tmp_path):
    with pytest.raises(SystemExit, match="fig8"):
        main(["--tiny", "--rows", "fig3,fig8", "--workspace", str(tmp_path), "--to", str(tmp_path)])
    assert not list(tmp_path.iterdir())


def test_settings_that_people_touch_are_shown_at_their_default_and_beside_it(report, tmp_path):
    to = ["--workspace", str(report.parent.parent), "--to", str(tmp_path)]
    page = touched.main(["--tiny", "--settings", "fine_lambda", "bounces", *to])
    sections = page.read_text(encoding="utf-8").split("\n## ")[1:]
    for one, said in zip(touched.TOUCHED[1::2], sections, strict=True):
        picture = f"touched-{one.setting}.png"
        assert f"({picture})" in said
        assert (tmp_path / picture).stat().st_size > 1000
        rows = [line.split("|")[1:-1] for line in said.splitlines() if line.startswith("| ")][2:]
        assert [row[0].strip().removesuffix(" (default)") for row in rows] == list(map(str, one.values))
        assert said.count("(default)") == 1
        assert len({tuple(row[1:]) for row in rows}) > 1


def test_a_scan_on_a_floor_has_one_colour_per_square_and_looks_outwards(tmp_path):
    write_mesh(tmp_path / "scan.ply", bowl(0.5))
    made = tmp_path / "made" / "scan.ply"
    write_on_a_floor(tmp_path / "scan.ply", made)
    assert [path.name for path in made.parent.iterdir()] == ["scan.ply"]
    surface, albedo = read_mesh(made), read_vertex_colours(made)
    halves = surface.faces[-12:]  # of every square the first, then of every square the second
    assert np.allclose(albedo[halves], albedo[halves[:, :1]])
    assert np.allclose(albedo[halves[[0, 6]]], [0.6, 0.45, 0.3], atol=0.005)
    a, b, c = (surface.vertices[halves[:, corner]] for corner in range(3))
    outwards = np.cross(b - a, c - a)
    assert (outwards[[0, 6], 1] > 0).all() and np.allclose(outwards[[0, 6]][:, [0, 2]], 0)
    box = np.delete(np.arange(12), [0, 6])
    centre = surface.vertices[halves[box]].reshape(-1, 3).mean(axis=0)
    assert (np.einsum("fk,fk->f", outwards[box], a[box] - centre) > 0).all()
