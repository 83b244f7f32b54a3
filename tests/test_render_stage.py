"""Scenes of known truth through the real stage and the command line: what is written agrees with itself."""

from __future__ import annotations

import importlib.util
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import drjit
import numpy as np
import open3d as o3d
import pytest
from scipy.ndimage import center_of_mass, label

from pipeline.cache.store import Store
from stages.cli import main
from stages.formats.artefacts.part_maps import read_part_map
from stages.formats.colmap.model import cameras_of, read_model
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import read_mask
from stages.formats.meshes.triangle_meshes import Surface, read_mesh, to_open3d, write_mesh
from stages.geometry.rays import RayCaster
from stages.known_geometry import KNOWN_GEOMETRY, KnownGeometrySettings
from stages.scene.cameras import Camera, project
from stages.synthetic.lights import ONE_LAMP, SKY_DOME, Light, lamps_around
from stages.synthetic.paints.paint import STRIPE, TABLE_1, paint_by_part
from stages.synthetic.photograph import NoiseTarget, mean_level, photograph
from stages.synthetic.render import Quality, Scene
from stages.synthetic.subjects.bust import PARTS
from stages.synthetic.subjects.subject import bust_subject
from stages.synthetic.truth import PaintedSurface, Truth
from stages.synthetic.views import arc_of_views
from tests.rendered_scene import TINY, artefact, ball, rendered, unshade, view, write_config

RENDERED = TINY | {"views": 3, "width_px": 30, "height_px": 48, "arc_deg": 40.0}
RENDERED |= {"noise": 0.03, "reflections": 1}
NAMES = ["000", "001", "002"]


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> Path:
    """A rendered scene without bounces, gone through to the end; not to be changed by a test."""
    path = write_config(
        tmp_path_factory.mktemp("rendered") / "tiny.yaml",
        render=RENDERED,
        decomposition={"paper": {"max_alternations": 2}},
    )
    assert main(["run", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def output(config) -> Path:
    return config.parent / "w/output"


@pytest.fixture(scope="module")
def scene_files(config) -> Path:
    """The folder of all that `render` wrote."""
    return artefact(config.parent / "w", "render", "")


def cameras(folder: Path) -> list[Camera]:
    return cameras_of(read_model(folder / "model"))


def test_the_whole_dataflow_writes_truth_and_result_side_by_side(config, output, scene_files):
    assert sorted(path.stem for path in (scene_files / "images").iterdir()) == NAMES
    for folder, suffix in (("albedo", ".exr"), ("shading", ".exr"), ("mask", ".png")):
        for place in (output, output / "truth"):
            assert sorted(path.stem for path in (place / folder).glob(f"*{suffix}")) == NAMES
    for name in NAMES:
        sizes = {read_exr(place / f"albedo/{name}.exr").shape for place in (output, output / "truth")}
        assert sizes == {(48, 30, 3)}
    assert json.loads((output / "truth/parts.json").read_text()) == {"parts": list(PARTS)}
    given = cameras(scene_files)
    assert [(camera.name, camera.shape) for camera in given] == [(name, (48, 30)) for name in NAMES]


def test_the_record_states_noise_and_samples_and_the_noise_wanted_is_met(config, capsys):
    code, told, _ = unshade(capsys, "show", config, "--stage", "render", "--json")
    facts = json.loads(told)["facts"]
    assert code == 0
    assert 0.005 < facts["noise"] <= 0.03
    assert len(facts["channel_noise"]) == 3
    assert len(facts["samples_per_pixel"]) == 3
    assert min(facts["samples_per_pixel"]) > 128
    assert facts["parts"] == list(PARTS)
    assert json.loads(told)["warnings"] == []


def test_show_prints_small_settings_as_they_are(config, capsys):
    _, table, _ = unshade(capsys, "show", config, "--stage", "render")
    lines = {line[:24].strip(): line[24:].strip() for line in table.splitlines()}
    assert lines["setting noise"] == "0.03"
    assert lines["setting spacing"] == "0.03"
    assert lines["setting stripe_period"] == "0.05"
    assert lines["setting elevations_deg"] == "5, 20"
    assert float(lines["fact noise"]) > 0.005


def test_the_truth_judged_by_itself_has_no_error(output, capsys):
    code, told, said = unshade(capsys, "evaluate", output / "truth/albedo", output / "truth", "--json")
    assert code == 0, said
    told = json.loads(told)
    assert set(told["si_rmse"].values()) == set(told["lmse"].values()) == {0}
    assert {cell["part"] for cell in told["variances"]} == set(PARTS)
    assert max(cell["variance"] for cell in told["variances"]) < 1e-12
    assert told["coverage"] == 1
    assert told["views"] == 3


def test_the_result_can_be_judged_by_the_truth_beside_it(output, capsys):
    code, told, said = unshade(capsys, "evaluate", output, output / "truth", "--json")
    assert code == 0, said
    assert json.loads(told)["coverage"] > 0.95
    assert 0 < json.loads(told)["si_rmse"]["red"] < 1


@pytest.fixture(scope="module")
def finer(scene_files) -> list[Truth]:
    """The truth of the first view by 16² rays per pixel, made here from the bust itself."""
    subject = bust_subject(RENDERED["spacing"])
    surface = PaintedSurface(subject.surface, paint_by_part(subject.parts), subject.parts + np.uint8(1))
    return [surface.truth(camera, samples_per_side=16) for camera in cameras(scene_files)]


def test_pixels_of_a_part_show_that_part_and_nothing_else(scene_files, finer):
    """Held against rays four times as dense, which see slivers that the stage's own rays may miss."""
    for name, dense in zip(NAMES, finer, strict=True):
        parts = read_part_map(scene_files / f"truth/parts/{name}.png", len(PARTS))
        mask = read_mask(scene_files / f"truth/mask/{name}.png")
        albedo = read_exr(scene_files / f"truth/albedo/{name}.exr")
        assert mask[parts > 0].all()
        assert (albedo[~mask] == 0).all()
        assert (parts > 0).sum() > 0.4 * mask.sum()
        for part, colour in enumerate(TABLE_1):
            here = parts == part + 1
            assert here.sum() > 10
            np.testing.assert_allclose(albedo[here], np.tile(colour, (here.sum(), 1)), atol=1e-6)
        assert (dense.parts != parts)[parts > 0].mean() < 0.01
        both = (parts > 0) & (dense.parts > 0)
        np.testing.assert_array_equal(parts[both], dense.parts[both])
        assert both.sum() > 0.8 * (dense.parts > 0).sum()  # and hardly a good pixel is given away


def test_image_is_albedo_times_an_independent_shading_up_to_the_measured_noise(config, scene_files, finer):
    """Eq. 1's premise I = ρ S: the shading from a render of the grey mesh on disk, with more samples."""
    grey, name = 0.5, NAMES[1]
    surface = read_mesh(scene_files / "true_mesh.ply")
    scene = Scene(surface, np.full((len(surface.vertices), 3), grey), SKY_DOME)
    shading = scene.photograph(cameras(scene_files)[1], Quality(samples=900, reflections=1), seed=77) / grey
    image, albedo = (
        read_exr(scene_files / f"images/{name}.exr"),
        read_exr(scene_files / f"truth/albedo/{name}.exr"),
    )
    error = (image - albedo * shading)[finer[1].parts > 0]
    level = image[read_mask(scene_files / f"masks/{name}.png")].mean()
    noise = Store(config.parent / "w").current("render").facts["noise"]
    assert 0.5 * noise < np.sqrt((error**2).mean()) / level < 1.1 * noise
    assert abs(error.mean()) < 0.1 * noise * level


def test_the_true_shading_is_image_over_albedo_where_the_albedo_is_known(scene_files):
    for name in NAMES:
        albedo, shading, image = (
            read_exr(scene_files / f"{folder}/{name}.exr")
            for folder in ("truth/albedo", "truth/shading", "images")
        )
        known = albedo >= 0.02
        np.testing.assert_allclose((albedo * shading)[known], image[known], rtol=1e-5)
        assert (shading[~known] == 0).all()


def markers(folder: Path) -> tuple[Path, Path]:
    """Four tilted black squares, side by side, and an all-white world: mesh and environment."""
    vertices, faces = [], []
    for k, (x, z) in enumerate([(-0.5, -0.5), (0.5, -0.45), (-0.45, 0.5), (0.5, 0.55)]):
        corners = 0.17 * np.array([[-1, 0.2, -1], [1, -0.3, -0.9], [0.9, -0.1, 1], [-1, 0.3, 0.8]])
        corners[2] = corners[0] + (corners[1] - corners[0]) * 0.9 + (corners[3] - corners[0]) * 1.1  # planar
        vertices.append(corners + [x, 0.1 * k, z])
        faces += [[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(np.concatenate(vertices)), o3d.utility.Vector3iVector(faces)
    )
    mesh.paint_uniform_color([0.0, 0.0, 0.0])
    o3d.io.write_triangle_mesh(str(folder / "markers.ply"), mesh)
    write_exr(folder / "white.exr", np.ones((4, 8, 3), np.float32))
    return folder / "markers.ply", folder / "white.exr"


def centroid(polygon: np.ndarray) -> np.ndarray:
    """Of the area within a polygon, (n, 2)."""
    following = np.roll(polygon, -1, axis=0)
    twice = polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1]
    return ((polygon + following) * twice[:, None]).sum(axis=0) / (3 * twice.sum())


def test_vertices_reproject_to_a_hundredth_of_a_pixel_of_where_they_are_seen(make_job, tmp_path):
    """Eq. 7, from mesh file and COLMAP model as written: the projected corners against the pictures."""
    mesh, white = markers(tmp_path)
    job = rendered(
        make_job, tmp_path / "job", object=mesh, environment=white, paint="vertex", light="environment",
        views=2, arc_deg=50.0, width_px=100, height_px=110, distance=3.0,
    )  # fmt: skip
    vertices = read_mesh(job.outputs["true_mesh"]).vertices.reshape(4, 4, 3)
    for camera in cameras(job.outputs["model"].parent):
        covered = 1 - view(job, "images", camera.name)[..., 0]
        blobs, count = label(covered > 1e-4)
        assert count == 4
        for corners in vertices:
            expected = centroid(project(camera, corners)[0])
            blob = blobs[tuple(np.floor(expected[::-1]).astype(int))]
            row, column = center_of_mass(covered, blobs, blob)
            np.testing.assert_allclose([column + 0.5, row + 0.5], expected, atol=0.01)


def test_the_vertices_that_a_view_sees_are_as_deep_as_the_mesh_is_there(scene_files):
    """Eq. 7 on the bust: a ray through the projected vertex ends at the vertex, for a third of them."""
    surface = read_mesh(scene_files / "true_mesh.ply")
    for camera in cameras(scene_files):
        large = camera.scaled(camera.width * 16, camera.height * 16)
        xy, depth = project(large, surface.vertices)
        assert ((xy > 0) & (xy < [large.width, large.height])).all()
        column, row = np.floor(xy).astype(int).T
        seen = RayCaster(surface).see(large).depth[row, column]
        assert 0.25 < (np.abs(seen - depth) < 0.002).mean() < 0.6


@pytest.mark.parametrize("light", ["one_lamp", "dome"])
def test_the_noise_that_is_reported_is_the_distance_from_the_truth(light):
    """Against twenty times the samples, bounces included: within a quarter, and below what was wanted."""
    subject = bust_subject(0.03)
    paint = paint_by_part(subject.parts)
    lamp = Light(None, lamps_around(ONE_LAMP, subject.centre, subject.radius))
    scene = Scene(subject.surface, paint, lamp if light == "one_lamp" else SKY_DOME)
    camera = arc_of_views([20.0], [10.0], 2.2, subject.centre, (24, 32), 64.0)[0]
    mask = PaintedSurface(subject.surface, paint).truth(camera).mask
    assert mask.sum() > 150
    quality = Quality(samples=16, reflections=4)
    target = NoiseTarget(0.06, mean_level(scene, [camera], [mask], quality))
    image, noise = photograph(scene, camera, mask, quality, target, seed=0)
    more = Quality(round(20 * noise.samples_per_pixel), reflections=4)
    reference = scene.photograph(camera, more, seed=10**6)
    error = np.sqrt(((image - reference)[mask] ** 2).mean() / (1 + 1 / 20)) / target.level
    assert noise.all == pytest.approx(error, rel=0.25)
    assert noise.all <= 0.06
    assert noise.samples_per_pixel > 2 * 16


def test_a_noise_out_of_reach_is_said_and_not_hidden(make_job, tmp_path, monkeypatch):
    monkeypatch.setattr("stages.synthetic.photograph.ROUNDS", 0)
    job = rendered(make_job, tmp_path, noise=1e-4)
    (sentence,) = job.warnings
    assert re.fullmatch(r"The noise stayed at 0\.0\d\d of the mean; expected 0\.0001 at most\.", sentence)
    assert job.facts["noise"] > 0.01
    assert job.facts["samples_per_pixel"] == [128]


def changed(capsys, config: Path, *words: str) -> dict[str, str]:
    """What a plan says of each stage."""
    code, told, said = unshade(capsys, "plan", config, "--json", *words)
    assert code == 0, said
    return {row["stage"]: row["action"] for row in json.loads(told)}


def test_what_follows_the_render_renders_nothing_again(config, capsys):
    assert set(changed(capsys, config).values()) == {"reuse"}
    smoothed = changed(capsys, config, "--set", "known_geometry.smoothing=3")
    assert list(smoothed) == [
        "render", "undistort", "known_geometry", "raycast", "correspondence", "transfer", "lighting",
        "decomposition", "export", "report",
    ]  # fmt: skip
    assert [stage for stage, action in smoothed.items() if action == "reuse"] == ["render", "undistort"]
    assert smoothed["known_geometry"] == "run"
    assert changed(capsys, config, "--set", "render.light=one_lamp")["render"] == "run"


def test_known_geometry_is_the_true_mesh_or_a_smoothed_one(make_job, scene_files, tmp_path):
    truth = read_mesh(scene_files / "true_mesh.ply")
    for steps in (0, 4):
        job = make_job(
            tmp_path / str(steps),
            KNOWN_GEOMETRY,
            KnownGeometrySettings(smoothing=steps),
            true_mesh=scene_files / "true_mesh.ply",
        )
        KNOWN_GEOMETRY.run(job)
        known = read_mesh(job.outputs["mesh"])
        np.testing.assert_array_equal(known.faces, truth.faces)
        moved = np.linalg.norm(known.vertices - truth.vertices, axis=1)
        assert job.facts["mean_move"] == pytest.approx(moved.mean())
        assert job.facts["largest_move"] == pytest.approx(moved.max())
        assert (moved.max() > 0) == (steps > 0)


def test_stripes_cover_their_part_only_and_belong_to_no_uniform_part(make_job, tmp_path):
    job = rendered(make_job, tmp_path, paint="stripes", stripe_period=0.4, width_px=48, height_px=64)
    plain = rendered(make_job, tmp_path / "plain", width_px=48, height_px=64)
    parts, unstriped = (read_part_map(one.outputs["truth"] / "parts/000.png", 4) for one in (job, plain))
    shirt = unstriped == PARTS.index("shirt") + 1
    np.testing.assert_array_equal(parts, np.where(shirt, 0, unstriped))
    albedo, before = view(job, "albedo"), view(plain, "albedo")
    np.testing.assert_array_equal(albedo[parts > 0], before[parts > 0])
    blue, yellow = (np.abs(albedo - colour).max(axis=-1) < 1e-6 for colour in (TABLE_1[2], STRIPE))
    assert (blue & shirt).sum() > 20
    assert (yellow & shirt).sum() > 20
    assert not (yellow & (parts > 0)).any()


def test_gloss_takes_its_share_from_the_albedo_of_the_glossy_parts(make_job, tmp_path):
    job = rendered(make_job, tmp_path, gloss=0.25, light="one_lamp", glossy_parts=("hair",))
    plain = rendered(make_job, tmp_path / "plain", light="one_lamp")
    parts = read_part_map(job.outputs["truth"] / "parts/000.png", 4)
    for part, name in enumerate(PARTS):
        shown = view(job, "albedo")[parts == part + 1]
        expected = TABLE_1[part] * (0.75 if name == "hair" else 1)
        assert len(shown) > 0
        np.testing.assert_allclose(shown, np.tile(expected, (len(shown), 1)), atol=1e-6)
    everywhere = rendered(make_job, tmp_path / "all", gloss=0.25, light="one_lamp", glossy_parts=())
    np.testing.assert_allclose(view(everywhere, "albedo"), 0.75 * view(plain, "albedo"), rtol=1e-5)


def test_paint_as_in_the_world_is_written_at_its_contrast(make_job, tmp_path):
    job = rendered(make_job, tmp_path, paint="masonry", contrast=0.3, subject="relief", width_px=64)
    mask, albedo = view(job, "mask"), view(job, "albedo")
    assert np.log(albedo[mask]).mean(axis=-1).std() == pytest.approx(0.3, rel=0.25)
    assert not read_part_map(job.outputs["truth"] / "parts/000.png", 4).any()
    assert job.facts["parts"] == ["wall", "niches", "mouldings", "steps"]
    assert len(read_mesh(job.outputs["true_mesh"]).faces) == job.facts["faces"]


def test_plaster_in_a_quilt_is_a_part_of_uniform_albedo(make_job, tmp_path):
    job = rendered(make_job, tmp_path, paint="quilt", paint_seed=8, width_px=48, height_px=64)
    parts = read_part_map(job.outputs["truth"] / "parts/000.png", 4)
    assert (parts > 0).sum() > 50
    for part in set(parts[parts > 0].tolist()):
        assert view(job, "albedo")[parts == part].std(axis=0).max() < 1e-5
    assert (parts > 0).sum() < 0.9 * view(job, "mask").sum()


def test_bare_metal_is_photographed_but_not_judged(make_job, tmp_path):
    metal = {"metal_part": "shirt", "roughness_contrast": 0.5, "light": "sun_and_sky"}
    job = rendered(make_job, tmp_path, **metal)
    plain = rendered(make_job, tmp_path / "plain", light="sun_and_sky")
    np.testing.assert_array_equal(view(job, "masks"), view(plain, "masks"))
    shirt = read_part_map(plain.outputs["truth"] / "parts/000.png", 4) == PARTS.index("shirt") + 1
    assert shirt.sum() > 20
    assert not view(job, "mask")[shirt].any()
    face = read_part_map(job.outputs["truth"] / "parts/000.png", 4) == PARTS.index("face") + 1
    assert view(job, "mask")[face].all()
    assert view(job, "images")[shirt].mean() > 0.05


def test_colours_of_an_object_are_its_albedo_in_linear_values(make_job, tmp_path):
    mesh = to_open3d(ball(0.1))
    mesh.paint_uniform_color(np.array([128, 255, 10]) / 255)
    o3d.io.write_triangle_mesh(str(tmp_path / "ball.ply"), mesh)
    job = rendered(make_job, tmp_path / "job", object=tmp_path / "ball.ply", paint="vertex")
    mask, albedo = view(job, "mask"), view(job, "albedo")
    assert mask.sum() > 100
    np.testing.assert_allclose(albedo[mask], np.tile([0.21586, 1.0, 0.0030353], (mask.sum(), 1)), rtol=1e-4)
    assert not read_part_map(job.outputs["truth"] / "parts/000.png", 4).any()


def test_the_texture_is_no_uniform_part(make_job, tmp_path):
    job = rendered(make_job, tmp_path, paint="texture")
    assert not read_part_map(job.outputs["truth"] / "parts/000.png", 4).any()
    assert view(job, "albedo")[view(job, "mask")].std() > 0.05


def test_noise_and_blur_of_the_camera_are_knobs_beside_the_light(make_job, tmp_path):
    """The same render with more noise, or less detail; the truth stays as it is, the shading does not."""
    clean, noisy, blurred = (
        rendered(make_job, tmp_path / name, **knob)
        for name, knob in {"clean": {}, "noisy": {"sensor_noise": 0.1}, "blurred": {"blur_px": 1.0}}.items()
    )
    mask, image = view(clean, "mask"), view(clean, "images")
    level = image[mask].mean()
    red = image[mask][:, 0]  # 0 nowhere, unlike blue
    added = (view(noisy, "images")[mask][:, 0] - red) / np.sqrt(red / level)
    assert added.std() / level == pytest.approx(0.1, rel=0.15)
    assert abs(added.mean()) < 0.02 * level
    soft = view(blurred, "images")
    assert soft.mean() == pytest.approx(image.mean(), rel=0.01)
    assert np.abs(np.diff(soft, axis=0)).sum() < 0.8 * np.abs(np.diff(image, axis=0)).sum()
    for job in (noisy, blurred):
        np.testing.assert_array_equal(view(job, "albedo"), view(clean, "albedo"))


def test_a_view_that_sees_nothing_whole_has_no_noise(make_job, tmp_path):
    """A sheet seen edge on: an empty mask, and a record without NaN, which is not JSON."""
    sheet = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1.0]])
    write_mesh(tmp_path / "sheet.ply", Surface(sheet, np.array([[0, 1, 2], [0, 2, 3]], np.int32)))
    job = rendered(make_job, tmp_path / "job", object=tmp_path / "sheet.ply", views=3, arc_deg=180.0)
    assert [view(job, "mask", name).any() for name in NAMES] == [False, True, False]
    assert 0 < job.facts["noise"] < 1
    json.dumps(job.facts, allow_nan=False)


@pytest.fixture
def renderer_threads() -> Iterator[Callable[[int], None]]:
    """How many threads Mitsuba may use, for the time of a test."""
    before = drjit.thread_count()
    yield drjit.set_thread_count
    drjit.set_thread_count(before)


def test_one_thread_and_many_write_the_same_files(make_job, renderer_threads, tmp_path):
    """More than a tile, more rounds than one, so that all that is summed in an order takes part."""
    written = []
    for threads in (1, 2, 5):
        renderer_threads(threads)
        folder = tmp_path / str(threads)
        job = rendered(make_job, folder, width_px=66, height_px=24, light="four_lamps", noise=0.03)
        assert job.facts["samples_per_pixel"][0] > 128
        files = {path.relative_to(folder): path for path in sorted(folder.rglob("*")) if path.is_file()}
        written.append({name: path.read_bytes() for name, path in files.items()} | {"facts": job.facts})
    assert len(written[0]) > 10
    assert written[0] == written[1] == written[2]


@pytest.mark.parametrize(
    ("render", "words", "sentence"),
    [
        (
            {"paint": "stripes", "striped_part": "tie"},
            [],
            "render.striped_part names the part 'tie'; this subject has hair, face, shirt, plinth.",
        ),
        ({"metal_part": "tie"}, [], "render.metal_part names the part 'tie'"),
        ({"gloss": 0.1, "glossy_parts": ["hair", "hat"]}, [], "render.glossy_parts names the part 'hat'"),
        ({"light": "environment"}, [], "render.light is environment, but none was given; give --environment"),
        ({"paint": "vertex"}, [], "render.paint is vertex, but no object was given; give --object FILE"),
        ({"paint": "vertex"}, ["--object", "ball.ply"], "ball.ply has no vertex colours; expected a PLY"),
        ({}, ["--object", "no.ply"], "--object no.ply does not exist; expected a file"),
        ({}, ["--object", "text.ply"], "text.ply has no PLY header"),
        ({"light": "environment"}, ["--environment", "text.hdr"], "text.hdr"),
        (
            {},
            ["--images", "photos"],
            "The settings of `render` ask for a rendered scene, but images was given",
        ),
        ({}, ["--set", "render.light=lamp"], "render.light is 'lamp'; expected 'dome', 'four_lamps'"),
        ({}, ["--set", "render.noise=0"], "render.noise is 0"),
        (
            None,
            ["--object", "ball.ply", "--images", "photos"],
            "but nothing is rendered; expected settings of",
        ),
        (None, ["--object", "ball.ply"], "but nothing is rendered; expected settings of `render`"),
    ],
)
def test_a_mistake_gets_a_sentence_and_exit_code_2(render, words, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "photos").mkdir()
    (tmp_path / "text.ply").write_text("no mesh")
    (tmp_path / "text.hdr").write_text("no picture")
    write_mesh(tmp_path / "ball.ply", ball(0.1))
    sections = {} if render is None else {"render": TINY | render}
    code, _, said = unshade(capsys, "run", write_config(tmp_path / "c.yaml", **sections), *words)
    assert code == 2
    assert sentence in said
    assert "Traceback" not in said


@pytest.mark.parametrize("missing", ["mitsuba", "skimage"])
def test_without_the_extra_the_command_names_it(missing, tmp_path, monkeypatch, capsys):
    there = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == missing else there(name, *rest)
    )
    code, _, said = unshade(capsys, "run", write_config(tmp_path / "c.yaml", render=TINY))
    assert code == 2
    assert "`sh setup.sh synthetic`" in said
