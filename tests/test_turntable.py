"""The textured model from all around: where the cameras stand, what they see, and the command."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from stages.cli import main
from stages.formats.artefacts.camera_file import read_cameras, write_cameras
from stages.formats.artefacts.surface_light_npz import StoredSurfaceLight, read_surface_light
from stages.formats.artefacts.transfer_file import read_transfer
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask, read_photo
from stages.formats.meshes.textured_models import read_model
from stages.formats.meshes.triangle_meshes import Surface, write_mesh
from stages.photometry.transport.directional_transport import even_directions
from stages.scene.cameras import project
from stages.synthetic.views import elevations_of, ring_of_views
from stages.texturing.rendering import TexturedSurface
from stages.transfer import TRANSFER, TransferSettings
from stages.turntable import TurntableSettings, cameras_around, frame_of
from tests.rendered_scene import TINY, artefact, towards_origin, unshade, write_config

RNG = np.random.default_rng(5)
Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # to z up, from y up


@pytest.mark.parametrize("upright", [np.eye(3), Y_UP])
def test_cameras_stand_evenly_around_at_one_height_and_see_all(upright):
    points = RNG.normal(size=(200, 3)) * [1, 2, 0.5] + [5, 0, 0]
    ring = ring_of_views(8, np.array([9.0, 1, 3]), 20.0, 3.0, points, (64, 48), upright)
    middle = (points @ upright.T).min(axis=0) / 2 + (points @ upright.T).max(axis=0) / 2
    centres = np.stack([camera.centre_in_world for camera in ring]) @ upright.T - middle
    assert elevations_of(ring, upright.T @ middle, upright) == pytest.approx(np.full(8, 20.0))
    turns = np.diff(np.unwrap(np.arctan2(centres[:, 1], centres[:, 0])))
    assert turns == pytest.approx(np.full(7, np.pi / 4)), "counter-clockwise"
    first = (upright @ [9.0, 1, 3] - middle)[:2]
    assert first @ centres[0, :2] == pytest.approx(np.linalg.norm(first) * np.linalg.norm(centres[0, :2]))
    for camera in ring:
        xy, depth = project(camera, points)
        assert (depth > 0).all() and (xy > 0).all() and (xy < [64, 48]).all()
        assert -(upright @ camera.rotation[1])[2] > 0.9, "up in the picture is up"


def test_the_first_picture_is_from_the_side_of_the_first_photo():
    surface = Surface(RNG.normal(size=(50, 3)), np.array([[0, 1, 2]], np.int32))
    photos = [towards_origin(azimuth, 25) for azimuth in (70, 0, -70)]
    ring = cameras_around(surface, photos, TurntableSettings(frames=4, side_px=32))
    there, here = photos[0].centre_in_world[:2], ring[0].centre_in_world[:2]
    assert there @ here > 0.95 * np.linalg.norm(there) * np.linalg.norm(here)


def test_vertices_of_no_face_do_not_count():
    surface = Surface(RNG.normal(size=(5, 3)), np.array([[0, 1, 2]], np.int32))
    stray = Surface(np.vstack([surface.vertices, [[500.0, 500, 500]]]), surface.faces)
    alone = Surface(surface.vertices[:3], surface.faces)
    photos = [towards_origin(azimuth, 25) for azimuth in (70, 0, -70)]
    rings = [cameras_around(one, photos, TurntableSettings(frames=2, side_px=32)) for one in (stray, alone)]
    for one, other in zip(*rings, strict=True):
        np.testing.assert_array_equal(one.cam_from_world, other.cam_from_world)


@pytest.fixture(scope="module")
def ball_over_floor(tmp_path_factory, make_job):
    """A ball that hovers above a floor, all white, and what its vertices see of the sky."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    x, y = np.meshgrid(*2 * [np.linspace(-2.5, 2.5, 60)])
    floor = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -0.8)])
    first = (np.arange(59)[:, None] * 60 + np.arange(59)).ravel()
    squares = np.stack([first, first + 1, first + 61, first + 60], axis=1)
    faces = np.concatenate([squares[:, [0, 1, 2]], squares[:, [0, 2, 3]], ball.faces + len(floor)])
    surface = Surface(np.concatenate([floor, ball.vertices]), faces.astype(np.int32))
    folder = tmp_path_factory.mktemp("floor")
    write_mesh(folder / "mesh.ply", surface)
    write_cameras(folder / "cameras.json", [towards_origin(0, 30)])
    job = make_job(
        folder / "out",
        TRANSFER,
        TransferSettings(),
        mesh=folder / "mesh.ply",
        cameras=folder / "cameras.json",
    )
    TRANSFER.run(job)
    return surface, read_transfer(job.outputs["transfer"])


@pytest.mark.parametrize("side", [-1, 1])
def test_a_shadow_falls_on_the_side_away_from_the_light(ball_over_floor, side):
    """From above: one direction of light, from ±x at 45°; the floor is dark at ∓x below the ball."""
    surface, stored = ball_over_floor
    white = all_white(surface)
    directions = even_directions(int(stored.directions))
    nearest = int(np.argmax(directions @ np.array([side, 0, 1]) / np.sqrt(2)))
    sky = np.zeros((len(directions), 3))
    sky[nearest] = 100.0
    light = StoredSurfaceLight(sky, np.zeros((len(stored.vertices), 3), np.float32), 1.0, 1.0)
    camera = towards_origin(0, 80, side_px=120, focal_px=100.0)
    frame = frame_of(white, camera, stored, light, TurntableSettings().sheet_offset, 2)[..., 0]
    towards = directions[nearest]
    below = -0.8 * towards / towards[2]  # where the ball's middle throws its shadow
    for place, dark in ((below, True), (below * [-1, -1, 1], False)):
        (column, row), _ = project(camera, place)
        assert (frame[int(row), int(column)] < 0.1 * np.quantile(frame, 0.9)) == dark
    np.testing.assert_allclose(frame.max(), 4 * 100 / len(directions), rtol=0.05)  # facing the light


def all_white(surface: Surface) -> TexturedSurface:
    uv = np.full((len(surface.vertices), 2), 0.5)
    return TexturedSurface.of_atlas(surface, uv, np.ones((2, 2, 3), np.float32))


@pytest.fixture(scope="module")
def turned(tmp_path_factory) -> Path:
    """A rendered bust, decomposed and shown from four sides under a low sun; not to be changed by a test."""
    render = TINY | {"views": 3, "width_px": 54, "height_px": 96, "noise": 0.05, "arc_deg": 60.0}
    config = write_config(
        tmp_path_factory.mktemp("turned") / "bust.yaml",
        render=render | {"spacing": 0.02},
        transfer={"directions": 64},
        turntable={"side_px": 64},
    )
    assert main(["relight", str(config), "--sun=60,25", "--turntable", "4"]) == 0
    return config.parent / "w"


def test_a_turn_has_its_pictures_and_an_animation(turned):
    folder = turned / "output/turntable"
    frames = [read_photo(folder / f"{number:03d}.png") for number in range(4)]
    assert all(frame.shape == (64, 64, 3) and frame.mean() > 0.01 for frame in frames)
    for one, other in zip(frames, frames[1:], strict=False):
        assert np.abs(one - other).mean() > 0.01
    with Image.open(folder / "turntable.gif") as animation:
        assert animation.n_frames == 4 and animation.size == (64, 64) and animation.info["loop"] == 0
    assert len(list(folder.iterdir())) == 5


def test_where_a_photo_was_taken_the_turntable_shows_what_relight_does(turned):
    output, found = turned / "output", []
    model = artefact(turned, "texture", "textured_model")
    given = read_model(model / "model.obj")
    assert given.base_colours == (model / "albedo.png",)
    textured = TexturedSurface(given.surface, given.uv, [read_exr(model / "albedo.exr")], given.texture)
    stored = read_transfer(artefact(turned, "transfer", "transfer.npz"))
    light = read_surface_light(artefact(turned, "relight", "surface_light.npz"))
    for camera in read_cameras(output / "cameras.json"):
        shown = frame_of(textured, camera, stored, light, TurntableSettings().sheet_offset, 2)
        mask = read_mask(output / f"mask/{camera.name}.png")
        relit = read_exr(output / f"relit/{camera.name}.exr")
        found.append((shown[mask], relit[mask]))
    shown, relit = (np.concatenate(views) for views in zip(*found, strict=True))
    assert np.sqrt(((shown - relit) ** 2).sum() / (relit**2).sum()) < 0.1
    assert np.median(shown) == pytest.approx(np.median(relit), rel=0.03)


def test_the_lit_side_is_the_side_of_the_sun(turned):
    """The sun is 60° to the right of the world's front: in front, right is brighter than left."""
    model = artefact(turned, "texture", "textured_model")
    surface = read_model(model / "model.obj").surface
    white = all_white(surface)
    stored = read_transfer(artefact(turned, "transfer", "transfer.npz"))
    light = read_surface_light(artefact(turned, "relight", "surface_light.npz"))
    (camera,) = ring_of_views(1, np.array([0, -9.0, 0]), 0.0, 3.0, surface.vertices, (64, 64), np.eye(3))
    frame = frame_of(white, camera, stored, light, TurntableSettings().sheet_offset, 2)[..., 0]
    left, right = frame[:, :32], frame[:, 32:]
    assert right[right > 0].mean() > 1.5 * left[left > 0].mean()


@pytest.mark.parametrize("count", ["0", "-3", "1000"])
def test_what_is_no_number_of_pictures_is_said(tmp_path, capsys, count):
    config = write_config(tmp_path / "bust.yaml", render=TINY)
    code, _, said = unshade(capsys, "relight", config, "--sun=0,30", f"--turntable={count}")
    assert code == 2 and "turntable.frames" in said and count in said
