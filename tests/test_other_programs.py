"""What unshade writes, opened by the programs that it is for: a validator, a browser, Blender, readers.

The validator and the browser come from npm, Blender as a Python module from PyPI (`tests/other_programs`,
pinned by lock files), into folders of this run; COLMAP is the machine's own. What is not there is skipped,
with the reason.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import trimesh
from PIL import Image

from benchmarks.texture.rerendering import outlines
from stages.cli import main
from stages.formats.artefacts.camera_file import read_cameras
from stages.formats.colour.srgb import srgb_from_linear
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_photo
from stages.formats.meshes.triangle_meshes import Surface
from stages.scene.cameras import Camera
from stages.scene.poses import inverse, with_flipped_camera_axes
from stages.scene.upright import upright_from_world
from stages.synthetic.views import ring_of_views
from stages.texture import TEXTURE
from stages.texturing.rendering import TexturedSurface

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parent.parent
TOOLS = ROOT / "tests/other_programs"
QUICK = ["--set", "raycast.reduce=2", "--set", "transfer.max_vertices=30000"]
UNREACHABLE = ("ENOTFOUND", "EAI_AGAIN", "ECONNREFUSED", "ECONNRESET", "ETIMEDOUT", "ENETUNREACH")
Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # glTF's axes from those whose z is up
UPRIGHT_WITHIN_DEG = TEXTURE.settings().upright_within_deg
SIDE = 400  # px, of a picture


@pytest.fixture(scope="module")
def output(tmp_path_factory) -> Path:
    """The output of the whole program on the sample's photos, with the textured model."""
    workspace = tmp_path_factory.mktemp("sample") / "w"
    words = ["run", str(ROOT / "configs/sample.yaml"), "--workspace", str(workspace), "--texture", *QUICK]
    assert main(words) == 0
    return workspace / "output"


@pytest.fixture(scope="module")
def tools(tmp_path_factory) -> Path:
    """A folder with the scripts and what npm installs for them."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        pytest.skip("no node or npm on this machine")
    folder = Path(shutil.copytree(TOOLS, tmp_path_factory.mktemp("npm") / "tools"))
    words = ["npm", "ci", "--no-audit", "--no-fund", "--ignore-scripts"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=600)
    if done.returncode and any(reason in done.stderr for reason in UNREACHABLE):
        pytest.skip("the npm registry cannot be reached")
    assert done.returncode == 0, done.stderr
    return folder


def node(tools: Path, *words: str | Path) -> str:
    """What a script prints; the browser unpacks itself into the folder."""
    command = ["node", *map(str, words)]
    environment = os.environ | {"TMPDIR": str(tools)}
    done = subprocess.run(command, cwd=tools, capture_output=True, text=True, timeout=600, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


def vertical_fov_deg(camera: Camera) -> float:
    return float(2 * np.rad2deg(np.arctan(camera.height / 2 / camera.focal_px)))


def seen_in_the_browser(tools: Path, model: Path, camera: Camera, lit: bool) -> np.ndarray:
    """The picture of a page that shows the model, (h, w, 3) in [0, 1], sRGB; its console must stay silent.

    The camera is in axes whose z is up.
    """
    target = camera.centre_in_world + camera.rotation[2]
    view = {
        "position": (Y_UP @ camera.centre_in_world).tolist(),
        "target": (Y_UP @ target).tolist(),
        "vertical_fov_deg": vertical_fov_deg(camera),
        "width": camera.width,
        "height": camera.height,
        "lit": lit,
    }
    (tools / "view.json").write_text(json.dumps(view), encoding="utf-8")
    said = json.loads(node(tools, "look.js", model, tools / "view.json", tools / "seen.png"))
    assert not said, said
    return srgb_from_linear(read_photo(tools / "seen.png"))


@pytest.fixture(scope="module")
def front(output) -> tuple[Surface, np.ndarray, Camera]:
    """The model in axes whose z is up, its texture coordinates, and a camera on the side of the photos."""
    model = trimesh.load_mesh(output / "model/model.glb", process=False)
    surface = Surface(np.asarray(model.vertices, float) @ Y_UP, np.asarray(model.faces, np.int32))
    photos = read_cameras(output / "cameras.json")
    upright = upright_from_world(photos, UPRIGHT_WITHIN_DEG)
    where = upright @ photos[len(photos) // 2].centre_in_world
    (camera,) = ring_of_views(1, where, 15.0, 3.0, surface.vertices, (SIDE, SIDE), np.eye(3))
    return surface, np.column_stack([model.visual.uv[:, 0], 1 - model.visual.uv[:, 1]]), camera


def by_our_rays(
    output: Path, front: tuple[Surface, np.ndarray, Camera]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the camera in front sees the model, its texture there as sRGB, and where no outline is near."""
    surface, uv, camera = front
    seen = TexturedSurface.of_atlas(surface, uv, read_photo(output / "model/albedo.png")).seen_by(camera)
    flat = np.zeros((*camera.shape, 3), np.float32)
    flat[seen.mask] = srgb_from_linear(seen.texture)
    return seen.mask, flat, seen.mask & ~outlines(camera, seen.mask, seen.depth)


@pytest.fixture(scope="module")
def blender(tmp_path_factory) -> Path:
    """A Python that has Blender's module; 500 MB are fetched."""
    if sys.version_info[:2] != (3, 11) or platform.machine() != "x86_64":
        pytest.skip("the module of Blender 4.2 is made for Python 3.11 on x86-64")
    folder = tmp_path_factory.mktemp("blender")
    venv.create(folder, with_pip=True)
    python = folder / "bin" / "python"
    words = [python, "-m", "pip", "install", "--quiet", "--require-hashes", "-r", TOOLS / "blender.lock"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=1200)
    if done.returncode and "NewConnectionError" in done.stderr:
        pytest.skip("the package index cannot be reached")
    assert done.returncode == 0, done.stderr
    return python


@dataclass(frozen=True, eq=False)
class InBlender:
    """What Blender tells of a model and renders of it: linear RGB, (h, w, 3), and coverage, (h, w)."""

    facts: dict[str, Any]
    lit: np.ndarray
    diffuse: np.ndarray
    coverage: np.ndarray


@pytest.fixture(scope="module")
def in_blender(blender, output, front, tmp_path_factory) -> InBlender:
    """The model, imported and rendered by Cycles under a sun above its left, from the camera in front."""
    folder, camera = tmp_path_factory.mktemp("rendered"), front[2]
    pose = inverse(with_flipped_camera_axes(camera.cam_from_world))
    view = {
        "world_from_camera": [*pose.tolist(), [0.0, 0.0, 0.0, 1.0]],
        "fov_deg": vertical_fov_deg(camera),
        "side": SIDE,
        "sun": [0.6, 0.3, -0.5],
    }
    (folder / "view.json").write_text(json.dumps(view), encoding="utf-8")
    model, passes = output / "model/model.glb", folder / "passes.exr"
    words = [blender, TOOLS / "blender_view.py", model, folder / "view.json", passes]
    done = subprocess.run(words, capture_output=True, text=True, timeout=1200)
    assert done.returncode == 0, done.stderr
    with OpenEXR.File(str(passes), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.parts[0].channels.items()}
    lit, diffuse = (
        np.stack([channels[f"ViewLayer.{name}.{colour}"] for colour in "RGB"], axis=-1)
        for name in ("Combined", "DiffCol")
    )
    return InBlender(json.loads(done.stdout.splitlines()[-1]), lit, diffuse, channels["ViewLayer.Combined.A"])


def test_the_validator_of_gltf_finds_nothing(output, tools):
    report = json.loads(node(tools, "validate.js", output / "model/model.glb"))
    issues = {kind: count for kind, count in report["issues"].items() if kind.startswith("num")}
    assert set(issues.values()) == {0}, report["issues"]["messages"]
    assert report["info"]["totalTriangleCount"] > 10_000 and report["info"]["hasTextures"]


def test_a_browser_shows_the_texture_where_our_own_rays_see_it(output, tools, front):
    """Without light, from one camera: three.js and our rays agree in shape, orientation and colour."""
    shown = seen_in_the_browser(tools, output / "model/model.glb", front[2], lit=False)
    seen, flat, inside = by_our_rays(output, front)
    hit = shown.max(axis=2) > 0
    assert (hit & seen).sum() > 0.95 * (hit | seen).sum() and 0.1 < hit.mean() < 0.9
    inner = hit & inside
    error = np.sqrt(np.mean((shown - flat)[inner] ** 2))
    assert -20 * np.log10(error) > 25
    assert np.abs((shown - flat)[inner].mean(axis=0)).max() < 0.01


def test_a_browser_lights_the_model(output, tools, front):
    shown = seen_in_the_browser(tools, output / "model/model.glb", front[2], lit=True)
    hit = shown.max(axis=2) > 0
    assert 0.1 < hit.mean() < 0.9 and shown[hit].std() > 0.05 and 0.1 < shown[hit].mean() < 0.9


def test_blender_finds_one_upright_object_with_its_textures(in_blender, output, front):
    facts, (surface, _, _) = in_blender.facts, front
    assert facts["objects"] == 1 and facts["triangles"] == len(surface.faces)
    np.testing.assert_allclose(facts["low"], surface.vertices.min(axis=0), atol=1e-5 * surface.diagonal)
    np.testing.assert_allclose(facts["high"], surface.vertices.max(axis=0), atol=1e-5 * surface.diagonal)
    side = read_exr(output / "model/albedo.exr").shape[0]
    assert sorted(facts["images"].values()) == [["Non-Color", side, side], ["sRGB", side, side]]


def test_the_diffuse_colour_that_blender_renders_is_the_albedo(in_blender, output, front):
    seen, flat, inside = by_our_rays(output, front)
    hit = in_blender.coverage > 0.5
    assert (hit & seen).sum() > 0.98 * (hit | seen).sum()
    inner = (in_blender.coverage > 0.999) & inside
    errors = (srgb_from_linear(in_blender.diffuse) - flat)[inner]
    assert -20 * np.log10(np.sqrt(np.mean(errors**2))) > 34
    assert np.abs(errors.mean(axis=0)).max() < 0.01


def test_blender_relights_the_model(in_blender):
    """Under one sun, part is in shade, and what is lit is the albedo times a shading without colour."""
    inner = (in_blender.coverage > 0.999) & (in_blender.diffuse.min(axis=2) > 0.02)
    shading = (in_blender.lit / np.where(inner[..., None], in_blender.diffuse, 1))[inner]
    bright = shading.mean(axis=1) > 0.3
    assert 0.2 < bright.mean() < 0.98
    assert np.abs(shading[bright] / shading[bright].mean(axis=1, keepdims=True) - 1).mean() < 0.05


def test_readers_of_pictures_find_size_channels_and_colour_space(output):
    with OpenEXR.File(str(output / "model/albedo.exr"), header_only=True) as file:
        header = file.parts[0].header
        assert {channel.name for channel in header["channels"]} == {"R", "G", "B"}
        np.testing.assert_allclose(np.ravel(header["chromaticities"])[:2], [0.64, 0.33], atol=1e-6)
    with OpenEXR.File(str(output / "model/confidence.exr"), header_only=True) as file:
        assert [channel.name for channel in file.parts[0].header["channels"]] == ["Y"]
    with Image.open(output / "albedo/000.png") as picture:
        assert "srgb" in picture.info
    side = read_exr(output / "model/albedo.exr").shape[0]
    with Image.open(output / "model/albedo.png") as picture:
        assert picture.mode == "RGB" and picture.size == (side, side)


@pytest.mark.parametrize("name", ["model.glb", "model.obj"])
def test_trimesh_finds_the_texture_of_the_model(output, name):
    with Image.open(output / "model/albedo.png") as picture:
        size = picture.size
    model = trimesh.load_mesh(output / "model" / name, process=False)
    assert len(model.faces) > 10_000 and model.visual.uv.min() >= 0 and model.visual.uv.max() <= 1
    material = model.visual.material
    with material.baseColorTexture if name.endswith("glb") else material.image as texture:
        assert texture.size == size


def test_colmap_opens_the_albedo_workspace(output, tmp_path):
    """The machine's own COLMAP, not the library that wrote it."""
    if shutil.which("colmap") is None:
        pytest.skip("no colmap on this machine")
    words = ["colmap", "model_analyzer", "--path", str(output / "dense/sparse")]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600)
    said = done.stdout + done.stderr
    assert done.returncode == 0 and "Registered images: 12" in said, said
    assert read_photo(output / "dense/images/000.png").shape[2] == 3
