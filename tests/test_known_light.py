"""A light that is given: how it is turned is found, its unit is kept, and what has no use for it says so."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stages.cli import main
from stages.formats.artefacts.view_files import ways_to_cameras
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import read_mask
from stages.photometry.lighting.illumination_by_known_light import illumination_by
from stages.photometry.lighting.known_light import KnownLight, _lowest
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.lighting.trusted_pixels import Viewing
from stages.photometry.transport.environment import directions_of_picture
from stages.photometry.transport.settings import EnvironmentMapSettings
from tests.rendered_scene import TINY, artefact, unshade, write_config
from tests.sphere_scene import sphere_scene
from tests.test_sky_light import error, normals_of, open_scene

MAP = EnvironmentMapSettings()
HOW = LightingSettings(samples=3000, bounces=0, still_light=0.1, moving_light=0.2)
SEEN = {"views": 4, "width_px": 54, "height_px": 96, "arc_deg": 90.0, "noise": 0.03, "spacing": 0.02}
ROLLED = 25  # of the picture's 128 columns
ROLLED_DEG = 360 * ROLLED / 128


def sun_and_sky(sharpness: float, rows: int = 64) -> np.ndarray:
    towards = directions_of_picture(rows)
    sun = np.array([0.6, -0.5, 0.62]) / np.linalg.norm([0.6, -0.5, 0.62])
    sky = 0.3 + 0.2 * np.maximum(towards[..., 2:], 0) * [0.8, 1.0, 1.4]
    glow = 6 * np.exp(sharpness * (towards @ sun - 1))[..., None] * [1.2, 1.0, 0.8]
    return (sky + glow).astype(np.float32)


def turn_between(one: float, other: float) -> float:
    return abs((one - other + 180) % 360 - 180)


@pytest.fixture(scope="module")
def sphere():
    """Stacked views of a painted sphere, what they see of the sky, its albedo, and ways to the cameras."""
    scene = sphere_scene(3)
    albedo = np.stack(scene.true_channels(), axis=1)
    towards = ways_to_cameras(scene.cameras, scene.masks)
    return scene.stacked(), open_scene(normals_of(scene)), albedo, towards


def illuminated(sphere, known: KnownLight, image: np.ndarray):
    views, sky, _, towards = sphere
    viewing = Viewing(np.ones(len(image), bool), towards, np.zeros(len(image), bool))
    channels = list(np.ascontiguousarray(image.T))
    return illumination_by(known, views, channels, sky, viewing, HOW, 1, lambda: None)


def photo_in(sphere, picture: np.ndarray, turn_deg: float) -> np.ndarray:
    _, sky, albedo, _ = sphere
    light = KnownLight(picture, np.eye(3), turn_deg, 1.0, MAP)
    return (albedo * sky.pixels.shading(light.radiance(sky.pixels.directions, turn_deg))).astype(np.float32)


@pytest.mark.parametrize("sharpness", [5.0, 200.0])
@pytest.mark.parametrize("turn_deg", [0.0, 123.0, 311.0])
def test_the_turn_is_found_whatever_unit_and_white_balance_the_picture_has(sphere, sharpness, turn_deg):
    picture = sun_and_sky(sharpness)
    image = photo_in(sphere, picture, turn_deg)
    in_another_unit = KnownLight.of(
        picture * np.array([20, 10, 4], np.float32), np.eye(3), turn_deg=None, scale=None, how=MAP
    )
    found = illuminated(sphere, in_another_unit, image)
    assert turn_between(found.turn_deg, turn_deg) <= 2 * HOW.known_light.fine_turn_step_deg
    assert np.allclose(found.light.shading.mean(axis=0), 1, atol=1e-3)
    assert error(image / found.light.shading, sphere[2]) < 0.05


def test_a_turn_that_is_given_is_kept(sphere):
    picture = sun_and_sky(20.0)
    known = KnownLight.of(picture, np.eye(3), turn_deg=200.0, scale=None, how=MAP)
    assert known.turns(HOW.known_light) == 0
    assert illuminated(sphere, known, photo_in(sphere, picture, 10.0)).turn_deg == 200.0


def test_in_the_photos_unit_the_albedo_is_absolute(sphere):
    """Images are compared scaled, here by 3; the light comes back in its own unit."""
    picture = sun_and_sky(20.0)
    image = photo_in(sphere, picture, 75.0)
    found = illuminated(sphere, KnownLight.of(picture, np.eye(3), 75.0, scale=1 / 3, how=MAP), image / 3)
    assert np.allclose(image / found.light.shading, sphere[2], rtol=0.02)
    expected = KnownLight(picture, np.eye(3), 75.0, 1.0, MAP).radiance(found.directions, 75.0)
    assert np.allclose(found.light.radiance[0], expected, rtol=1e-4)


def test_the_lowest_around_a_circle_are_no_neighbours():
    left = np.array([0.1, 0.5, 0.3, 0.4, 0.2, 0.6, 0.7, 0.15])
    assert _lowest(left, 3).tolist() == [0, 4, 2]
    assert _lowest(np.ones(8), 3).tolist() == [0, 1, 2], "where nothing tells turns apart, some all the same"


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> Path:
    """A bust in light of which a turned picture of other colour is given; not to be changed by a test."""
    folder = tmp_path_factory.mktemp("known")
    picture = sun_and_sky(60.0)
    write_exr(folder / "light.exr", picture)
    turned = np.roll(picture, -ROLLED, axis=1)
    write_exr(folder / "turned.exr", turned)
    write_exr(folder / "measured.exr", (turned * [8, 4, 2]).astype(np.float32))
    config = write_config(
        folder / "known.yaml",
        sources={"environment": "light.exr", "known_light": "measured.exr"},
        render=TINY | SEEN | {"light": "environment"},
        transfer={"degree": 3},
    )
    assert main(["run", str(config)]) == 0
    return config


def facts_of(config: Path) -> dict:
    record = artefact(config.parent / "w", "lighting", "record.json")
    return json.loads(record.read_text(encoding="utf-8"))["facts"]


def test_the_turn_of_a_rendered_scene_s_light_is_found_within_a_step_of_the_grid(config, capsys):
    facts = facts_of(config)
    assert turn_between(facts["known_light_turned_by_deg"], -ROLLED_DEG) <= HOW.known_light.turn_step_deg
    assert facts["light_distance"] == "infinitely far"
    output = config.parent / "w/output"
    code, told, said = unshade(capsys, "evaluate", output / "albedo", output / "truth", "--json")
    assert code == 0, said
    assert max(json.loads(told)["si_rmse"].values()) < 0.04
    lighting = json.loads((output / "lighting.json").read_text(encoding="utf-8"))
    brightest = np.argmax(np.sum(lighting["radiance"][0], axis=1))
    sun = np.array([0.6, -0.5, 0.62])
    assert lighting["directions"][brightest] @ sun > np.cos(np.deg2rad(15)) * np.linalg.norm(sun)


def test_a_light_in_the_unit_of_the_photos_gives_albedo_that_needs_no_scale(config):
    known = ["--known-light", str(config.parent / "turned.exr"), "--set", "lighting.known_scale=fixed"]
    assert main(["run", str(config), *known]) == 0
    output = config.parent / "w/output"
    albedo, truth = (read_exr(output / f"{kind}/001.exr") for kind in ("albedo", "truth/albedo"))
    mask = read_mask(output / "mask/001.png") & (truth.min(axis=2) > 0.02)
    assert np.allclose(np.median(albedo[mask] / truth[mask], axis=0), 1, atol=0.05)
    assert "unit of the images" in json.loads((output / "lighting.json").read_text(encoding="utf-8"))["gauge"]
    assert main(["run", str(config)]) == 0


def test_a_turn_that_is_set_is_not_sought(config):
    assert main(["run", str(config), "--to", "lighting", "--set", "lighting.known_turn_deg=30"]) == 0
    assert facts_of(config)["known_light_turned_by_deg"] == 30
    assert main(["run", str(config)]) == 0


def test_what_has_no_use_for_a_known_light_is_refused(config, capsys, tmp_path):
    for words, sentence in (
        (["--set", "decomposition.mode=paper"], "the light is of the kind 'paper'"),
        (["--set", "decomposition.light=harmonics"], "the light is of the kind 'harmonics'"),
        (["--set", "lighting.lights=per-view"], "one picture is one light for all views"),
        (["--known-light", tmp_path / "none.exr"], "--known-light"),
    ):
        code, _, said = unshade(capsys, "plan", config, *words)
        assert code == 2
        assert sentence in said.replace("\n", " ")


def test_without_it_the_light_is_sought(config, capsys):
    code, told, said = unshade(capsys, "plan", config, "--json")
    assert code == 0, said
    assert {row["action"] for row in json.loads(told)} == {"reuse"}
    text = json.loads(config.read_text(encoding="utf-8"))
    del text["sources"]["known_light"]
    (config.parent / "unknown.yaml").write_text(json.dumps(text), encoding="utf-8")
    code, told, _ = unshade(capsys, "plan", config.parent / "unknown.yaml", "--json")
    reasons = {row["stage"]: row["reason"] for row in json.loads(told)}
    assert reasons["lighting"] == "input known_light is no longer given"
