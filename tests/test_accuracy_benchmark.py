"""`benchmarks.accuracy`, from render to report, too small to mean much."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy import from_photos, touched, two_lights
from benchmarks.accuracy.__main__ import arguments, main, scenes_of
from benchmarks.accuracy.from_photos import develop
from benchmarks.accuracy.natural import natural_rows, unseen_rows
from benchmarks.accuracy.on_a_floor import write_on_a_floor
from benchmarks.accuracy.reliability import Reliability
from benchmarks.accuracy.relighting import in_another_light
from benchmarks.accuracy.report import light_distance, worst_variance
from benchmarks.accuracy.scenes import laboratory_of, paper_rows
from benchmarks.paper.laboratory import TINY, Results
from stages.evaluation.part_variance import part_variances
from stages.formats.colmap.model import pinhole_model
from stages.formats.images.exr import write_exr
from stages.formats.images.photos import read_photo, write_mask
from stages.formats.meshes.triangle_meshes import read_mesh, read_vertex_colours, write_mesh
from stages.motion.sfm_settings import SfmSettings
from stages.photometry.transport.environment import directions_of_picture
from stages.synthetic.paints.natural_paint import NATURAL_PAINTS
from stages.synthetic.render_settings import RenderSettings
from stages.synthetic.views import arc_of_views
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


def test_confidence_is_compared_with_what_is_wrong(report):
    numbers = json.loads(report.with_name("accuracy.json").read_text(encoding="utf-8"))
    page = report.read_text(encoding="utf-8")
    section = page.split("## Confidence of")[1].split("\n## ")[0]
    for name, methods in numbers.items():
        told = methods["mode: transfer"]["reliability"]
        assert sum(told["held"]) == pytest.approx(1)
        row = next(line for line in section.splitlines() if line.startswith(f"| {name} "))
        assert row.split("|")[2].split() == [f"{value:.2f}" for value in told["held"]]
        assert "reliability" not in methods["mode: paper"]


def test_confidence_that_knows_the_error_is_as_wrong_as_it_says():
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.2, 0.8, (20_000, 1)) * [1.0, 0.8, 0.5]
    sigma = rng.uniform(0.02, 0.3, 20_000)
    albedo = truth * np.exp(sigma * rng.standard_normal(20_000))[:, None]
    told = Reliability.of(1 / (1 + (sigma / 0.1) ** 2), albedo, truth)
    assert np.allclose(told.measured, told.expected, rtol=0.15)
    assert told.held[0] > 0.4
    assert np.all(np.diff(told.held) < 0)
    blind = Reliability.of(np.zeros(20_000), albedo, truth)
    assert np.isinf(blind.expected).all()
    assert np.allclose(blind.held, 0.2, atol=0.03)


@pytest.mark.slow  # the fast one, on stored renders, is in tests/test_accuracy.py
def test_albedos_under_two_lights_differ_less_than_photos(tmp_path):
    page = two_lights.main(["--tiny", "--workspace", str(tmp_path), "--to", str(tmp_path / "to")])
    row = next(
        line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| courtyard")
    )
    photos, albedos, ratio = row.split("|")[2:5]
    assert float(ratio) == pytest.approx(
        np.mean([float(v) for v in albedos.split()]) / np.mean([float(v) for v in photos.split()]), abs=0.03
    )
    assert float(ratio) < 0.6
    assert next((tmp_path / "to").glob("*.png")).stat().st_size > 1000


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
        picture = f"touched-{one.name}.png"
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


def test_scenes_like_the_world_differ_and_need_no_data_where_they_are_our_own():
    rows = [row for row, _ in natural_rows(Path("data"))]
    assert len({row.name for row in rows}) == len(rows) >= 10
    kinds = {row.render["paint"] for row in rows}
    assert kinds == set(NATURAL_PAINTS)
    assert {row.render["contrast"] for row in rows} >= {0.05, 0.6}
    assert sum(row.photographed for row in rows) == 3
    assert any(row.known_geometry for row in rows)
    own = natural_rows(None)
    assert 0 < len(own) < len(rows)
    assert not any(row.sources for row, _ in own)


def test_unseen_scenes_are_drawn_by_seed_and_share_no_paint_with_those_developed_on():
    drawn = [unseen_rows(Path("data"), seed) for seed in (0, 0, 1)]
    assert drawn[0] == drawn[1] != drawn[2]
    known = {row.render["paint_seed"] for row, _ in natural_rows(Path("data"))}
    for rows in drawn:
        assert len({row.name for row, _ in rows}) == len(rows) == 8
        assert not known & {row.render["paint_seed"] for row, _ in rows}
        assert all(0.05 <= row.render["contrast"] <= 0.6 for row, _ in rows)
        assert len({row.render["paint"] for row, _ in rows}) == 8
        for row, _ in rows:
            RenderSettings(**row.render)
    assert not any(row.sources for row, _ in unseen_rows(None, 0))


def test_rows_of_the_world_are_chosen_by_a_word_and_refused_by_name():
    given = arguments(["--natural", "--rows", "relief-sun_and_sky-masonry-30"])
    ((row, _),) = scenes_of(given)
    assert row.render["paint"] == "masonry"
    with pytest.raises(SystemExit, match="fig3"):
        scenes_of(arguments(["--unseen", "3", "--rows", "fig3"]))


def test_photos_are_developed_from_a_render_in_8_bits_and_exposed_alike(tmp_path):
    images = {"000": np.full((6, 5, 3), 0.5, np.float32), "001": np.full((6, 5, 3), 2.0, np.float32)}
    for name, image in images.items():
        write_exr(tmp_path / f"images/{name}.exr", image)
        write_mask(tmp_path / f"masks/{name}.png", np.ones((6, 5), bool))
    folder = develop({"images": tmp_path / "images", "masks": tmp_path / "masks"}, tmp_path / "photos")
    dark, bright = (read_photo(folder / f"{name}.png") for name in images)
    assert sorted(path.name for path in folder.iterdir()) == ["000.png", "001.png"]
    np.testing.assert_allclose(bright, 1.0, atol=1e-6)
    np.testing.assert_allclose(dark, 0.25, atol=0.003)


def test_a_photographed_row_starts_from_photos_with_its_lens_held(tmp_path, monkeypatch):
    """Two dataflows: the render alone, then the photos' own, of which nothing but lens and masks is known."""
    row = natural_rows(None)[-1][0]
    assert row.photographed
    camera = arc_of_views([0.0], [0.0], 3.0, np.zeros(3), (20, 16), 50.0)[0]
    (tmp_path / "model").mkdir()
    pinhole_model([camera], extension=".exr").write(tmp_path / "model")
    write_exr(tmp_path / "images/000.exr", np.full((16, 20, 3), 0.3, np.float32))
    write_mask(tmp_path / "masks/000.png", np.ones((16, 20), bool))
    given = {}

    def record(flow, sources, settings, workspace, last, threads, listener):
        given[last] = ([stage.name for stage in flow], dict(sources), settings)
        return Results({name: tmp_path / name for name in ("images", "masks", "model", "truth")}, {last: {}})

    monkeypatch.setattr(from_photos, "results_of", record)
    results = laboratory_of(row, TINY, tmp_path / "w").run_with(row, {"mode": "transfer"})
    assert list(given) == ["render", "decomposition"]
    flow, sources, settings = given["decomposition"]
    assert flow[:5] == ["sfm", "undistort", "mvs", "mesh", "refine"]
    assert set(sources) == {"images", "masks"}
    assert [path.name for path in sources["images"].iterdir()] == ["000.png"]
    assert settings["sfm"]["camera_params"] == [50.0, 50.0, 10.0, 8.0]
    assert SfmSettings(**settings["sfm"]).holds_cameras
    assert results.paths["truth"] == tmp_path / "truth"
