"""Another light on the views: the picture of it, the frame it is held in, and the command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import read_mask, write_png_srgb8
from stages.photometry.transport.directional_transport import even_directions
from stages.photometry.transport.environment import directions_of_picture, light_of_picture, picture_of_light
from stages.photometry.transport.lit_scenes import LitScene
from stages.photometry.transport.pixel_transfer import Bounces
from stages.photometry.transport.relighting import relit
from stages.photometry.transport.settings import EnvironmentMapSettings, LightPictureSettings
from stages.photometry.transport.transfer_vectors import Occlusion, Proxy
from stages.scene.upright import upright_from_world, vertical_of
from stages.synthetic.lights import SKY_DOME, ClearSky, clear_sky_picture, dome_picture
from tests.rendered_scene import TINY, artefact, unshade, write_config
from tests.sphere_scene import camera_looking_at_origin

NAMES = ["000", "001", "002"]
COUNT = 256
MAP = EnvironmentMapSettings()


def test_light_of_a_picture_keeps_its_power_and_its_place():
    rng = np.random.default_rng(0)
    picture = rng.random((40, 80, 3))
    light = light_of_picture(picture, even_directions(COUNT), MAP)
    angle = np.sin(np.pi * (np.arange(40) + 0.5) / 40)[:, None, None]
    power = (picture * angle).sum(axis=(0, 1)) / (angle.sum() * 80)
    assert np.allclose(light.mean(axis=0), power, rtol=0.02)
    smooth = np.maximum(directions_of_picture(40) @ np.array([0.6, 0.0, 0.8]), 0)[..., None] * np.ones(3)
    expected = np.maximum(even_directions(COUNT) @ np.array([0.6, 0.0, 0.8]), 0)
    assert np.allclose(light_of_picture(smooth, even_directions(COUNT), MAP)[:, 0], expected, atol=0.05)
    slanted = np.maximum(directions_of_picture(1200) @ np.array([0.5, -0.6, 0.62]), 0)[..., None] * np.ones(3)
    expected = np.maximum(even_directions(COUNT) @ np.array([0.5, -0.6, 0.62]), 0)
    assert np.allclose(light_of_picture(slanted, even_directions(COUNT), MAP)[:, 0], expected, atol=0.05)
    coarse = light_of_picture(picture[:4, :8], even_directions(COUNT), MAP)
    assert np.isfinite(coarse).all()
    assert coarse.min() > 0


def test_a_light_comes_back_from_its_picture():
    radiance = np.maximum(even_directions(COUNT) @ np.array([[0.6], [0.0], [0.8]]), 0) * np.ones(3)
    picture = picture_of_light(even_directions(COUNT), radiance, LightPictureSettings())
    back = light_of_picture(picture, even_directions(COUNT), MAP)
    assert np.allclose(back, radiance, atol=0.05)


def test_under_even_light_open_surface_shows_its_albedo():
    """Eq. 1 with the same shading everywhere."""
    normals, none = even_directions(400), sp.csr_array((1, 1), dtype=np.float32)
    scene = LitScene.of(
        normals,
        sp.csr_array((400, 1), dtype=np.float32),
        Proxy(
            np.zeros((1, 3)),
            np.array([[0.0, 0, 1]], np.float32),
            Occlusion(np.zeros((1, 9), np.float32), none, none),
        ),
        np.zeros((1, COUNT // 8), np.uint8),
        COUNT,
        None,
    )
    albedo = np.linspace(0.1, 1.0, 1200).reshape(400, 3)
    albedo[7] = [9.0, 7.0, 5.0]  # a label, far brighter than all else
    shown, shading = relit(
        scene, albedo, np.full((COUNT, 3), 2.0), Bounces(count=3, brightest=0.5, quantile=0.99)
    )
    assert np.allclose(shading, 2, rtol=0.02)
    ratio = shown / albedo
    assert np.allclose(ratio, ratio[0, 0], rtol=0.03)


@pytest.mark.parametrize("up", [[0, 0, 1], [0, -1, 0], [0, 0, -1], [1, 1, 1]])
def test_up_is_an_axis_where_one_is_near_and_the_cameras_own_otherwise(up):
    """Cameras around the origin, looking down a little; the world turned so that up is elsewhere."""
    up = np.array(up) / np.linalg.norm(up)
    cameras = []
    for angle in np.deg2rad([0, 120, 240]):
        own = camera_looking_at_origin("a", 3 * np.array([np.cos(angle), np.sin(angle), 0.2]), 20, 20, 30.0)
        cameras.append(own)
    to_world = np.linalg.inv(_rotation_to(up))
    turned = [_turned(camera, to_world) for camera in cameras]
    upright = upright_from_world(turned, 20.0)
    assert np.allclose(upright @ upright.T, np.eye(3))
    assert np.linalg.det(upright) == pytest.approx(1)
    assert np.allclose(upright @ up, [0, 0, 1], atol=1e-6)


def test_up_is_found_though_all_cameras_look_down_from_one_side():
    """The mean of their up axes leans by as much as they look down; hands are not steady."""
    rng = np.random.default_rng(3)
    cameras = []
    for angle in np.deg2rad([-30, -18, -6, 6, 18, 30]):
        place = 3 * np.array([np.sin(angle), -np.cos(angle), np.tan(np.deg2rad(35))])
        level = camera_looking_at_origin("a", place, 20, 20, 30.0)
        roll = np.deg2rad(rng.normal(0, 1.5))
        turn = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
        cameras.append(replace(level, cam_from_world=turn @ level.cam_from_world))
    mean = -np.mean([camera.rotation[1] for camera in cameras], axis=0)
    assert mean[2] / np.linalg.norm(mean) < np.cos(np.deg2rad(30)), "no test if the mean would do"
    assert vertical_of(cameras)[2] > np.cos(np.deg2rad(4))
    assert np.allclose(upright_from_world(cameras, 10.0), np.eye(3))


def test_where_all_look_the_same_way_up_is_their_own():
    one = camera_looking_at_origin("a", np.array([0.0, -3, 1]), 20, 20, 30.0)
    assert np.allclose(vertical_of([one, one]), -one.rotation[1])


def _rotation_to(up: np.ndarray) -> np.ndarray:
    """Rows: a frame whose third axis is `up`."""
    side = np.cross(up, [0.3, 0.5, -0.4])
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(up, side), up])


def _turned(camera, to_world):
    pose = np.column_stack([camera.rotation @ to_world.T, camera.cam_from_world[:, 3]])
    return replace(camera, cam_from_world=pose)


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> Path:
    render = TINY | {"views": 3, "width_px": 54, "height_px": 96, "noise": 0.05, "spacing": 0.02}
    return write_config(
        tmp_path_factory.mktemp("relit") / "dome.yaml", render=render, transfer={"directions": 64}
    )


def test_under_the_light_that_it_was_taken_in_a_view_looks_like_its_photo(config, capsys):
    light = config.parent / "dome.exr"
    write_exr(light, dome_picture(SKY_DOME.dome).radiance)
    code, _, said = unshade(capsys, "relight", config, "--light", light)
    assert code == 0, said
    output = config.parent / "w/output"
    shown, photo = [], []
    for name in NAMES:
        mask = read_mask(output / f"mask/{name}.png")
        shown.append(read_exr(output / f"relit/{name}.exr")[mask])
        photo.append(read_exr(artefact(config.parent / "w", "undistort", "linear") / f"{name}.exr")[mask])
        assert (output / f"relit/{name}.png").is_file()
    shown, photo = np.concatenate(shown), np.concatenate(photo)
    scale = (shown * photo).sum(axis=0) / (shown**2).sum(axis=0)
    off = np.sqrt(((scale * shown - photo) ** 2).sum() / (photo**2).sum())
    assert off < 0.15
    plan = json.loads(unshade(capsys, "plan", config, "--json")[1])
    assert "relight" not in {row["stage"] for row in plan}


def test_the_paper_s_albedo_can_be_relit_too(config, capsys):
    light = config.parent / "dome.exr"
    write_exr(light, dome_picture(SKY_DOME.dome).radiance)
    paper = ["--set", "decomposition.mode=paper", "--set", "decomposition.paper.max_alternations=2"]
    code, _, said = unshade(capsys, "relight", config, "--light", light, *paper)
    assert code == 0, said


def test_a_sun_is_the_light_of_its_sky(config, capsys):
    """As the same sky as an environment map; from the other side, what was bright is dark."""
    output, seen = config.parent / "w/output", {}
    light = config.parent / "sun.exr"
    write_exr(light, clear_sky_picture(ClearSky(sun_azimuth_deg=-60, sun_elevation_deg=25)).radiance)
    for name, words in (
        ("map", ("--light", light)), ("left", ("--sun=-60,25",)), ("right", ("--sun", "60,25")),
    ):  # fmt: skip
        code, _, said = unshade(capsys, "relight", config, *words)
        assert code == 0, said
        masks = [read_mask(output / f"mask/{view}.png") for view in NAMES]
        views = [read_exr(output / f"relit/{view}.exr") for view in NAMES]
        seen[name] = np.concatenate([view[mask] for view, mask in zip(views, masks, strict=True)])
    np.testing.assert_array_equal(seen["left"], seen["map"])
    brightness = [seen[side].mean(axis=1) for side in ("left", "right")]
    assert np.corrcoef(*brightness)[0, 1] < 0.7


@pytest.mark.parametrize("given", ["40", "a,b", "40,30,20", "40,-5", "400,20", "40,", "nan,20"])
def test_what_is_no_sun_is_said(config, capsys, given):
    code, _, said = unshade(capsys, "relight", config, f"--sun={given}")
    assert code == 2 and "sun" in said and "expected" in said


def test_what_is_no_light_is_said(config, capsys):
    code, _, said = unshade(capsys, "relight", config)
    assert code == 2
    assert "No light was given" in said
    code, _, said = unshade(capsys, "relight", config, "--light", config, "--sun", "40,30")
    assert code == 2 and "Two lights were given" in said
    square = config.parent / "square.exr"
    write_exr(square, np.ones((8, 8, 3), np.float32))
    code, _, said = unshade(capsys, "relight", config, "--light", square)
    assert code == 2
    assert "twice as wide as high" in said.replace("\n", " ")
    night = config.parent / "night.exr"
    write_exr(night, np.zeros((8, 16, 3), np.float32))
    code, _, said = unshade(capsys, "relight", config, "--light", night)
    assert code == 2
    assert "is black; expected light" in said.replace("\n", " ")
    day = config.parent / "day.png"
    write_png_srgb8(day, np.full((8, 16, 3), 0.5))
    code, _, said = unshade(capsys, "relight", config, "--light", day)
    assert code == 2
    assert "expected EXR or HDR" in said.replace("\n", " ")
    code, _, said = unshade(capsys, "relight", config, "--light", config.parent / "nowhere.exr")
    assert code == 2
    assert "--light" in said
