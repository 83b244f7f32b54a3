"""The stages `correspondence` and `decomposition` on files: a painted sphere goes in, maps come out."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from pipeline import Job, Silence, Stage, UserError
from stages.correspondence import CORRESPONDENCE, CorrespondenceSettings
from stages.decomposition import DECOMPOSITION, DecompositionSettings
from stages.formats.artefacts.camera_file import write_cameras
from stages.formats.artefacts.correspondence_files import numbered_correspondences
from stages.formats.artefacts.light_npz import StoredLight, read_light, write_light
from stages.formats.artefacts.lighting_json import LightAround, write_light_around
from stages.formats.artefacts.view_files import (
    read_arrays,
    read_maps,
    scaled_channels,
    write_arrays,
    write_maps,
)
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import write_mask
from stages.photometry.lighting.settings import TrustedPixelSettings
from stages.photometry.lighting.trusted_pixels import unclipped
from stages.photometry.paper.harmonics import shading_basis
from stages.scene.cameras import Camera
from stages.scene.upright import vertical_of
from tests.raw_exr import write_raw_exr
from tests.sphere_scene import SphereScene, camera_looking_at_origin, sphere_scene


class CountedSteps(Silence):
    """Progress that nobody watches; it counts."""

    steps = 0

    def advance(self, steps=1):
        self.steps += steps


def write_scene(folder: Path, scene: SphereScene, magnify: int = 2) -> dict[str, Path]:
    """Lay the scene out as the stages before would; the linear images `magnify` times as large."""
    inputs = {name: folder / name for name in ("depth", "normal", "mask", "linear")}
    inputs["cameras"] = folder / "cameras.json"
    write_cameras(inputs["cameras"], scene.cameras)
    for i, camera in enumerate(scene.cameras):
        write_exr(inputs["depth"] / f"{camera.name}.exr", scene.depths[i])
        write_exr(inputs["normal"] / f"{camera.name}.exr", scene.normals[i])
        large = np.repeat(np.repeat(scene.images[i], magnify, axis=0), magnify, axis=1)
        write_exr(inputs["linear"] / f"{camera.name}.exr", 7 * large)
        write_mask(inputs["mask"] / f"{camera.name}.png", scene.masks[i])
    return inputs


def run_stage(stage: Stage, folder: Path, inputs: dict[str, Path], settings, threads: int = 2) -> Job:
    outputs = {artefact.name: folder / artefact.path for artefact in stage.gives}
    for artefact in stage.gives:
        if artefact.file is None:
            outputs[artefact.name].mkdir(parents=True)
    with ThreadPoolExecutor(threads) as executor:
        job = Job(settings, inputs, outputs, folder, threads, executor, CountedSteps(), lambda sentence: None)
        stage.run(job)
    return job


@pytest.fixture(scope="module")
def scene() -> SphereScene:
    return sphere_scene(3, 24, 20)


@pytest.fixture(scope="module")
def linked(scene, tmp_path_factory) -> tuple[dict[str, Path], Job]:
    folder = tmp_path_factory.mktemp("scene")
    inputs = write_scene(folder, scene)
    job = run_stage(CORRESPONDENCE, folder / "one", inputs, CorrespondenceSettings())
    return inputs | {"correspondences": job.outputs["correspondences"]}, job


SHORT = {"mode": "paper", "paper": {"max_alternations": 4}, "lambda": 1.5, "mu": 1.0}


@pytest.fixture(scope="module")
def decomposed(linked, tmp_path_factory) -> Job:
    return run_stage(DECOMPOSITION, tmp_path_factory.mktemp("out"), linked[0], DecompositionSettings(**SHORT))


def test_correspondences_are_one_file_per_pair_in_order(scene, linked):
    folder = linked[0]["correspondences"]
    rows = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    assert [(row["i"], row["j"]) for row in rows] == [
        ("view 0", "view 1"),
        ("view 0", "view 2"),
        ("view 1", "view 2"),
    ]
    for row, expected in zip(rows, scene.correspondences.values(), strict=True):
        correspondences = sp.load_npz(folder / row["file"])
        assert correspondences.nnz == row["links"]
        # Depths went through float32: a link on the brink of ε may fall the other way.
        assert abs(correspondences.astype(int) - expected.astype(int)).sum() <= 0.01 * expected.nnz
    assert linked[1].facts["links"] == sum(row["links"] for row in rows)


def test_both_stages_give_the_same_bytes_on_any_number_of_threads(linked, decomposed, tmp_path):
    again = run_stage(CORRESPONDENCE, tmp_path / "c", linked[0], CorrespondenceSettings(), threads=1)
    for path in sorted(linked[0]["correspondences"].iterdir()):
        assert (again.outputs["correspondences"] / path.name).read_bytes() == path.read_bytes()
    again = run_stage(DECOMPOSITION, tmp_path / "d", linked[0], DecompositionSettings(**SHORT), threads=1)
    for name in ("albedo", "shading"):
        for path in decomposed.outputs[name].iterdir():
            assert np.array_equal(read_exr(again.outputs[name] / path.name), read_exr(path))
    for name in ("lighting", "energy"):
        assert again.outputs[name].read_bytes() == decomposed.outputs[name].read_bytes()


def test_the_smoothed_energy_in_the_file_falls_at_every_step(decomposed):
    content = json.loads(decomposed.outputs["energy"].read_text(encoding="utf-8"))
    assert content["settings"]["lambda"] == 1.5
    for channel in ("red", "green", "blue"):
        rows = content["channels"][channel]["alternations"]
        assert [row["alternation"] for row in rows] == [1, 2, 3, 4]
        for row in rows:
            smoothed = row["smoothed"]
            assert smoothed["after_albedo"] <= smoothed["after_light"] <= smoothed["before"]
            assert row["energy"] == pytest.approx(
                row["photo"] + 1.5 * row["smooth"] + content["settings"]["mu"] * row["multi_view"], rel=1e-12
            )


def test_albedo_comes_back_in_the_images_own_scale_and_in_the_gauge(scene, decomposed):
    """Σ|ρ| = Σ|I| per channel, with I as it lay on disk; zero outside the mask."""
    albedos = [read_exr(decomposed.outputs["albedo"] / f"{c.name}.exr") for c in scene.cameras]
    for albedo, mask in zip(albedos, scene.masks, strict=True):
        assert not albedo[~mask].any()
    of_albedo = sum(np.abs(albedo).sum(axis=(0, 1), dtype=float) for albedo in albedos)
    of_images = sum(7 * image.sum(axis=(0, 1)) for image in scene.images)
    assert np.allclose(of_albedo, of_images, rtol=1e-5)


def test_shading_is_the_stored_light_on_the_stored_normals(scene, decomposed):
    lighting = json.loads(decomposed.outputs["lighting"].read_text(encoding="utf-8"))
    for i, camera in enumerate(scene.cameras):
        view = lighting["views"][i]
        assert view["name"] == camera.name
        light = np.array([view[channel] for channel in ("red", "green", "blue")])
        expected = shading_basis(scene.normals[i]) @ light.T
        found = read_exr(decomposed.outputs["shading"] / f"{camera.name}.exr")
        assert np.allclose(found[scene.masks[i]], expected[scene.masks[i]], atol=1e-5)
        assert not found[~scene.masks[i]].any()


def test_what_did_not_converge_is_said(decomposed):
    assert decomposed.facts["outcomes"] == 3 * ["limit_reached"]
    assert len(decomposed.warnings) == 3
    assert decomposed.warnings[0].startswith("The red channel: limit reached")
    assert decomposed.facts["negative_shading"].keys() == {"red", "green", "blue"}


def test_black_images_are_refused_with_a_way_out(linked, scene, tmp_path):
    inputs = dict(linked[0]) | {"linear": tmp_path / "black"}
    for camera in scene.cameras:
        write_exr(inputs["linear"] / f"{camera.name}.exr", np.zeros((*camera.shape, 3), np.float32))
    with pytest.raises(UserError, match=r"black inside the masks .* Check that the masks"):
        run_stage(DECOMPOSITION, tmp_path / "out", inputs, DecompositionSettings(mode="paper"))


def test_images_of_which_hardly_anything_is_lit_are_scaled_by_what_is():
    dark = np.zeros((1000, 3))
    dark[3] = 0.25
    channels, scale = scaled_channels(dark)
    assert scale == 0.25 and channels[0].max() == 1


def test_pairs_of_views_without_links_take_no_room(tmp_path):
    cameras = sphere_scene(view_count=3).cameras
    one = sp.csr_array(([1.0], ([2], [3])), shape=(4, 5))
    for file, block in (("none.npz", 0 * one), ("one.npz", one)):
        block.eliminate_zeros()
        sp.save_npz(tmp_path / file, block)
    names = [camera.name for camera in cameras]
    rows = [
        {"i": names[0], "j": names[k], "file": file, "links": k - 1}
        for k, file in ((1, "none.npz"), (2, "one.npz"))
    ]
    (tmp_path / "index.json").write_text(json.dumps(rows), encoding="utf-8")
    assert list(numbered_correspondences(tmp_path, cameras)) == [(0, 2)]


def test_what_is_clipped_is_a_matter_of_its_view():
    """A glint in one linear image says nothing about the white of another photo."""
    photo = np.array([[0.5, 0.5, 0.5], [1.0, 0.9, 0.8], [0.99, 0.2, 0.2]])
    assert unclipped(photo, TrustedPixelSettings()).tolist() == [True, False, False]
    assert unclipped(np.vstack([photo, [7.0, 7.0, 7.0]]), TrustedPixelSettings()).all()


def test_pixels_that_are_not_numbers_are_refused_by_name(linked, scene, tmp_path):
    inputs = dict(linked[0]) | {"linear": tmp_path / "nan"}
    for camera in scene.cameras:
        write_raw_exr(inputs["linear"] / f"{camera.name}.exr", np.full((*camera.shape, 3), np.nan))
    with pytest.raises(UserError, match=r"View view 0 has \d+ values .* not numbers"):
        run_stage(DECOMPOSITION, tmp_path / "out", inputs, DecompositionSettings(mode="paper"))


def test_views_that_share_nothing_are_warned_about(tmp_path):
    scene = SphereScene()
    for side in (1.0, -1.0):
        one = sphere_scene(1, 24, 20)
        camera = camera_looking_at_origin(f"side {side}", np.array([0.0, 6 * side, 0.1]), 24, 20, 60.0)
        for name in ("depths", "masks", "normals", "albedos", "shadings"):
            getattr(scene, name).extend(getattr(one, name))
        scene.cameras.append(camera)
    job = run_stage(CORRESPONDENCE, tmp_path / "out", write_scene(tmp_path, scene), CorrespondenceSettings())
    assert job.facts == {"pairs": 1, "links": 0, "pairs_without_links": 1}
    assert "overlap" in job.warnings[0]


def test_world_up_is_the_vertical_of_the_cameras(scene):
    """The sphere's cameras all stand upright, looking down a little, from one side."""
    up = vertical_of(scene.cameras)
    assert np.linalg.norm(up) == pytest.approx(1)
    assert up[2] > np.cos(np.deg2rad(2))
    level = Camera("level", 2, 2, np.eye(3), np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0]]))
    assert np.allclose(vertical_of([level]), [0, 0, 1])


@pytest.mark.parametrize(("radius", "distance"), [(np.inf, None), (5.0, 5.0)])
def test_light_from_all_around_is_written_from_plain_arrays(scene, tmp_path, radius, distance):
    directions, radiance = np.eye(3), np.arange(18.0).reshape(2, 3, 3)
    of_view, gains, cells = np.array([0, 1, 1]), np.full((3, 3), 0.5), np.array([0.5, 0.25, 0.25])
    light = LightAround(directions, cells, radiance, of_view, gains, np.array([1.0, 2, 3]), radius)
    write_light_around(tmp_path / "lighting.json", scene.cameras, light, image_scale=7.0)
    told = json.loads((tmp_path / "lighting.json").read_text(encoding="utf-8"))
    assert (told["centre"], told["distance"], told["image_scale"]) == ([1, 2, 3], distance, 7)
    assert (told["directions"], told["radiance"]) == (directions.tolist(), radiance.tolist())
    assert told["cells"] == cells.tolist()
    assert told["views"][1] == {"name": scene.cameras[1].name, "light": 1, "gain": [0.5] * 3}


@pytest.mark.parametrize("radius", [np.inf, 5.0])
def test_the_light_that_was_found_comes_back_bit_by_bit(tmp_path, radius):
    rng = np.random.default_rng(0)
    directions, radiance = rng.normal(size=(7, 3)), rng.random((2, 7, 3)).astype(np.float32)
    gains, cells = rng.random((3, 3)), np.full(7, 1 / 7)
    around = LightAround(directions, cells, radiance, np.array([0, 1, 1]), gains, rng.random(3), radius)
    light = StoredLight(
        around, 0.7, rng.random(3), rng.random(3), 0.2, glossy=True, trusted=False, brightest=0.4
    )
    write_light(tmp_path / "light.npz", light)
    found = read_light(tmp_path / "light.npz")
    for name in ("directions", "cells", "radiance", "light_of_view", "gains", "centre"):
        before, after = (getattr(one.around, name) for one in (light, found))
        assert np.array_equal(before, after) and before.dtype == after.dtype
    assert found.around.radius == radius
    assert np.array_equal(found.specular_strength, light.specular_strength)
    assert np.array_equal(found.mean_shading, light.mean_shading)
    assert (found.image_scale, found.specular_roughness, found.glossy, found.trusted) == (
        0.7,
        0.2,
        True,
        False,
    )


def test_what_is_no_light_is_refused_with_a_way_out(tmp_path):
    for content in (b"", b"not an archive"):
        (tmp_path / "light.npz").write_bytes(content)
        with pytest.raises(UserError, match=r"cannot be read as light .* expected light.npz as in"):
            read_light(tmp_path / "light.npz")


def test_values_of_pixels_come_back_bit_by_bit_from_their_views(scene, tmp_path):
    rng = np.random.default_rng(0)
    count = sum(int(mask.sum()) for mask in scene.masks)
    seen, trusted = rng.normal(size=(count, 3)).astype(np.float32), rng.random(count) < 0.5
    views = scene.cameras, scene.masks
    write_arrays(tmp_path, *views, {"seen": seen, "trusted": trusted})
    found = read_arrays(tmp_path, scene.cameras, ("trusted", "seen"))
    assert np.array_equal(found["seen"], seen) and found["seen"].dtype == np.float32
    assert np.array_equal(found["trusted"], trusted) and found["trusted"].dtype == bool
    write_maps(tmp_path, *views, seen)
    assert np.array_equal(read_maps(tmp_path, *views), seen)
