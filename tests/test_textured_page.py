"""The textured model as a report has it: places in textures, several of them, none that is too large."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stages.formats.images.exr import write_exr
from stages.formats.images.photos import write_png8
from stages.formats.meshes.textured_models import ObjCorners, Texture, read_model, write_obj
from stages.reporting.content.page_scene import POSITION_CODES, PageScene
from stages.reporting.content.textured_surface import TexturedSurface
from stages.reporting.settings import SurfaceSettings

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
TWO_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
SIDE, BRIGHTER = 64, 0.25


def square_of(folder, labels: tuple[str, str]) -> Path:
    """A square of two triangles, the second on another UDIM tile, whose textures are of one colour each."""
    uv = np.array([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [1.1, 0.1], [1.9, 0.9], [1.1, 0.9]])
    corners = np.column_stack([TWO_TRIANGLES.reshape(-1), np.arange(6), np.zeros(6, int)])
    obj = ObjCorners(SQUARE, uv, np.array([[0.0, 0, 1]]), np.full(2, 3), corners, np.array([1, 0]))
    textures = []
    for number, label in enumerate(labels):
        files = {
            kind: folder / f"{kind}.{1001 + number}" for kind in ("albedo", "shading", "confidence", "normal")
        }
        colour = np.full((SIDE, SIDE, 3), BRIGHTER * (1 + number), np.float32)
        write_exr(Path(f"{files['albedo']}.exr"), colour)
        write_exr(Path(f"{files['shading']}.exr"), 2 * np.ones_like(colour))
        write_exr(Path(f"{files['confidence']}.exr"), np.ones((SIDE, SIDE), np.float32))
        images = [Path(f"{files[kind]}.png") for kind in ("albedo", "normal")]
        for image in images:
            write_png8(image, np.full((SIDE, SIDE, 3), 128, np.uint8))
        textures.append(Texture(label, np.array([1 - number]), *images))
    write_obj(folder / "model.obj", obj, tuple(textures))
    return folder


@pytest.fixture
def model(tmp_path) -> Path:
    return square_of(tmp_path, ("1001", "1002"))


@pytest.mark.parametrize("materials", [("wall  a", "wall a"), ("a#1", "a_1"), (" b ", "\n"), ("木", "石")])
def test_textures_are_found_whatever_their_materials_are_called(tmp_path, materials):
    found = read_model(square_of(tmp_path, materials) / "model.obj")
    pictures = [found.base_colours[number].name for number in found.texture]
    assert pictures == ["albedo.1002.png", "albedo.1001.png"]


def test_faces_are_in_the_order_of_their_textures_and_places_within_them(model):
    surface = TexturedSurface.of(model, SurfaceSettings())
    assert surface.faces_of.tolist() == [1, 1]
    names = [colour.name for colour in surface.base_colours]
    first = surface.surface.vertices[surface.surface.faces[0]]
    on_tile = {"albedo.1001.png": [[0, 0, 0], [1, 1, 0], [0, 1, 0]], "albedo.1002.png": SQUARE[:3].tolist()}
    assert sorted(first.tolist()) == sorted(on_tile[names[0]])
    assert surface.uv.min() >= 0.0999 and surface.uv.max() <= 0.9001
    np.testing.assert_allclose(np.abs(surface.normals[:, 2]), 1, atol=1e-6)


def test_pictures_share_the_side_and_the_white(model):
    how = SurfaceSettings(texture_px=64)
    first, second = TexturedSurface.of(model, how).pictures(1.0, how)
    for pictures in (first, second):
        assert {kind: picture.shape for kind, picture in pictures.items()} == dict.fromkeys(
            ("albedo", "photo", "shading", "confidence", "relief"), (32, 32, 3)
        )
        assert (pictures["shading"] == 255).all()
    assert len({first["albedo"].max(), second["albedo"].max()}) == 2


def test_a_model_of_too_many_faces_is_left_to_its_vertices(model):
    assert TexturedSurface.of(model, SurfaceSettings(most_textured_faces=1)) is None


def test_a_scene_brings_the_surface_far_from_the_origin_into_its_box():
    """As georeferenced models are: their places are coded without loss beyond the code's own."""
    far = 1e6 + SQUARE * [3.0, 2.0, 1.0]
    scene = PageScene.around(far, np.eye(3))
    np.testing.assert_allclose(scene.placed(far) * 3, SQUARE * [3, 2, 1], atol=1e-9)
    np.testing.assert_allclose(scene.middle, [0.5, 1 / 3, 0])
    assert scene.placed(far).max() * POSITION_CODES <= 65535.001
