"""Relief that the photos contradict is weakened; relief that they show, and its paint, stay as they are."""

from __future__ import annotations

import numpy as np
import pytest

import stages
from benchmarks.paper.laboratory import results_of
from pipeline.command.terminal import Terminal
from stages import additions
from stages.formats.images.exr import read_exr
from stages.photometry.relief.photo_on_mesh import normals_at
from stages.photometry.relief.settings import ReliefSettings
from stages.photometry.relief.supported_relief import Cubes, Photo, supported_normals
from stages.photometry.relief.vertex_smoothing import VertexSmoothing, radii_of

SIDE = 120  # vertices
TOWARDS = np.array([0.6, 0.3, 0.74])  # of the light
SCENE = {
    "render": {
        "subject": "relief",
        "paint": "masonry",
        "light": "sun_and_sky",
        "views": 4,
        "arc_deg": 60.0,
        "width_px": 96,
        "height_px": 80,
        "noise": 0.05,
        "spacing": 0.016,
    },
    "transfer": {"max_vertices": 4000},
    "lighting": {"samples": 4000, "bounces": 0, "specular": {"remove": False}},
}


def grid():
    """Vertices of a flat square, (V, 3), and its faces, (F, 3)."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij"))
    number = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = (
        part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:])
    )
    faces = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)]).astype(np.int32)
    return np.stack([x, y, np.zeros_like(x)], axis=1).astype(float), faces


def unit(vectors):
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


def log_shading(normals):
    return np.log(np.maximum(normals @ TOWARDS, 0.02))


def waves(places, length):
    """Normals of relief with waves of a length, edges."""
    slope = 0.3 * np.sin(2 * np.pi * places / length)
    return unit(np.stack([slope[:, 0], slope[:, 1], np.ones(len(places))], axis=1))


def kept(mesh_normals, true_normals, paint, log_shading=log_shading, known=None):
    places, faces = grid()
    how = ReliefSettings()
    smoothing = VertexSmoothing.of(faces, len(places), how.steps, how.wider)
    cubes = [Cubes.of(places, how.window * radius) for radius in radii_of(smoothing.steps[1:], 1.0)]
    known = np.ones(len(places), bool) if known is None else known
    photo = Photo(log_shading(true_normals) + paint, known)
    return supported_normals(smoothing.normals(mesh_normals), smoothing, cubes, photo, log_shading, how)


def apart_deg(one, other):
    return float(np.degrees(np.median(np.arccos(np.clip(np.einsum("nk,nk->n", one, other), -1, 1)))))


@pytest.fixture
def paint():
    """Stones of different albedo, 8 edges wide, with grain."""
    rng = np.random.default_rng(1)
    stones = rng.normal(0, 0.3, (SIDE // 8 + 1, SIDE // 8 + 1)).repeat(8, axis=0).repeat(8, axis=1)
    return (stones[:SIDE, :SIDE] + rng.normal(0, 0.05, (SIDE, SIDE))).ravel()


@pytest.mark.parametrize("length", [12, 30])
def test_relief_that_the_photos_show_stays(paint, length):
    relief = waves(grid()[0], length)
    found, shares = kept(relief, relief, paint)
    assert apart_deg(found, relief) < 1, shares


def test_vertices_that_nothing_lights_and_no_photo_shows_change_nothing(paint):
    """As the inside of a double wall: one number that is none spread over all."""
    relief, dark = waves(grid()[0], 12), np.arange(SIDE * SIDE) < 3

    def with_dark(normals):
        return np.where(dark, np.nan, log_shading(normals))

    found, shares = kept(relief, relief, paint, with_dark, ~dark)
    assert apart_deg(found[~dark], relief[~dark]) < 1, shares


def test_noise_on_smooth_surface_goes(paint):
    rng = np.random.default_rng(2)
    flat = waves(grid()[0], 1e9)
    noisy = unit(flat + rng.normal(0, 0.25, flat.shape))
    found, shares = kept(noisy, flat, paint)
    assert apart_deg(found, flat) < apart_deg(noisy, flat) / 2, shares


def test_noise_goes_where_it_is_and_relief_stays_where_that_is(paint):
    rng, places = np.random.default_rng(3), grid()[0]
    there = places[:, 0] > SIDE / 2
    relief = np.where(there[:, None], waves(places, 12), waves(places, 1e9))
    noisy = np.where(there[:, None], relief, unit(relief + rng.normal(0, 0.25, relief.shape)))
    found, _ = kept(noisy, relief, paint)
    far = np.abs(places[:, 0] - SIDE / 2) > 10
    assert apart_deg(found[there & far], relief[there & far]) < 1.5
    assert apart_deg(found[~there & far], relief[~there & far]) < 0.6 * apart_deg(
        noisy[~there & far], relief[~there & far]
    )


def test_a_mesh_that_no_photo_shows_is_kept():
    places, faces = grid()
    relief, how = waves(places, 12), ReliefSettings()
    smoothing = VertexSmoothing.of(faces, len(places), how.steps, how.wider)
    cubes = [Cubes.of(places, how.window * radius) for radius in radii_of(smoothing.steps[1:], 1.0)]
    photo = Photo(np.zeros(len(places)), np.zeros(len(places), bool))
    found, _ = supported_normals(smoothing.normals(relief), smoothing, cubes, photo, log_shading, how)
    np.testing.assert_allclose(found, relief, atol=1e-5)


def test_cubes_sum_up_what_they_interpolate():
    rng = np.random.default_rng(4)
    cubes = Cubes.of(rng.uniform(0, 10, (500, 3)), 2.0)
    values = rng.normal(size=500)
    assert np.isclose(cubes.sums(values).sum(), values.sum())
    np.testing.assert_allclose(cubes.interpolated(np.full(cubes.count, 3.0)), 3, rtol=1e-6)


def test_normals_at_pixels_face_the_camera():
    of_vertices = np.array([[0, 0, 1], [0, 1, 1], [1, 0, 1]], float)
    faces, barycentric = np.array([[0, 1, 2]] * 2), np.array([[0.25, 0.25], [0.25, 0.25]])
    found = normals_at(of_vertices, faces, barycentric, np.array([[0, 0, 1.0], [0, 0, -1.0]]))
    np.testing.assert_allclose(found[0], -found[1])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=1e-6)


def test_all_stages_behind_it_take_its_normals_and_none_before():
    plain = additions.with_relighting(stages.dataflow(["images"]))
    flow = {stage.name: stage for stage in additions.with_shading_normals(plain)}
    assert "normal" in flow["correspondence"].takes
    for name in ("lighting", "export", "relight"):
        assert "shading_normal" in flow[name].takes, name
        assert "normal" not in flow[name].takes, name
    shown = {one.output for stage in flow.values() for one in stage.gives if one.name.endswith("normal")}
    assert shown == {None, "normal"}
    with_report = additions.with_report(tuple(flow.values()))
    assert "shading_normal" in with_report[-1].takes
    paper = stages.dataflow(["images"], "paper")
    assert additions.with_shading_normals(paper) == paper


def test_normals_of_an_exact_mesh_are_kept_and_shown(tmp_path):
    given = SCENE | {"shading_normals": {"weaken": True}}
    flow = additions.with_shading_normals(stages.experiment({}))
    done = results_of(flow, {}, given, tmp_path / "w", "shading_normals", 2, Terminal())
    assert done.facts["shading_normals"]["turned_deg"] < 2
    for file in sorted(done.paths["normal"].glob("*.exr")):
        before, after = read_exr(file), read_exr(done.paths["shading_normal"] / file.name)
        there = before.any(axis=2)
        assert not after[~there].any()
        np.testing.assert_allclose(np.linalg.norm(after[there], axis=1), 1, rtol=1e-5)
        assert np.einsum("nk,nk->n", before[there], after[there]).min() > 0
