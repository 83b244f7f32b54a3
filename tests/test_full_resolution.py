"""The albedo carried to the photos' own resolution: laws of the core, and the command."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from PIL import Image

from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import encode_srgb8, write_mask
from stages.formats.images.resize import reduce_by_area
from stages.full_resolution import View, write_view
from stages.geometry.lenses import PhotoAndAlbedo
from stages.photometry.full_resolution import at_full_resolution
from stages.photometry.full_resolution_settings import FullResolutionSettings
from stages.scene.cameras import Camera
from tests.raw_exr import write_raw_exr
from tests.rendered_scene import TINY, unshade, write_config

RNG = np.random.default_rng(0)
HOW = FullResolutionSettings()


def painted(rows: int = 60, columns: int = 84) -> tuple[np.ndarray, np.ndarray]:
    """Albedo in slanted stripes of two paints, and light that changes slowly over it, (h, w, 3)."""
    y, x = np.mgrid[:rows, :columns] + 0.5
    stripes = ((x + 0.6 * y) % 17 < 8)[..., None]
    albedo = np.where(stripes, [0.8, 0.3, 0.2], [0.2, 0.4, 0.7]).astype(np.float32)
    return albedo, (0.3 + x / columns + (y / rows) ** 2).astype(np.float32)[..., None] * np.ones(
        3, np.float32
    )


def test_nothing_changes_where_the_sizes_are_equal():
    albedo, shading = painted()
    mask = RNG.random(albedo.shape[:2]) < 0.8
    fine, known = at_full_resolution(albedo, mask, albedo * shading, photographed(albedo), HOW)
    assert np.array_equal(known, mask)
    assert np.array_equal(fine, np.where(mask[..., None], albedo, 0))


def test_edges_of_paint_are_as_sharp_as_in_the_photo():
    truth, shading = painted()
    coarse = reduce_by_area(truth, (20, 28))
    everywhere = np.ones(coarse.shape[:2], bool)
    fine, known = at_full_resolution(coarse, everywhere, truth * shading, photographed(truth), HOW)
    assert known.all()
    blurred = cv2.resize(coarse, truth.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    assert np.abs(fine - truth).mean() < 0.15 * np.abs(blurred - truth).mean()


def test_what_is_not_known_stays_so_and_does_not_bleed_in():
    truth, shading = painted()
    coarse = reduce_by_area(truth, (20, 28))
    mask = np.ones(coarse.shape[:2], bool)
    mask[:, 14:] = False
    poisoned = np.where(mask[..., None], coarse, 1e6).astype(np.float32)
    results = []
    for background in (0.0, 10.0):
        photo = truth * shading
        photo[:, 42:] = background
        fine, known = at_full_resolution(poisoned, mask, photo, photographed(truth), HOW)
        assert known[:, :41].all()
        assert not known[:, 43:].any()
        assert np.all(fine[~known] == 0)
        results.append(fine[:, :41])
    assert np.array_equal(*results)
    assert np.abs(results[0] - truth[:, :41]).mean() < 0.02
    nothing, none = at_full_resolution(coarse, np.zeros_like(mask), photo, photographed(truth), HOW)
    assert not none.any()
    assert not nothing.any()
    beyond = photographed(truth)
    beyond[:5] = False
    _, known = at_full_resolution(coarse, mask, photo, beyond, HOW)
    assert not known[:5].any()


def photographed(image: np.ndarray) -> np.ndarray:
    return np.ones(image.shape[:2], bool)


@pytest.mark.parametrize("width", [1, 2, 3, 4])
def test_a_thin_pole_keeps_its_own_albedo_in_its_own_light(width):
    """The nearest pixels inside the mask are another thing's."""
    albedo, shading = np.zeros((40, 40, 3), np.float32), np.ones((40, 40, 3), np.float32)
    albedo[25:, 5:35], albedo[5:25, 20 : 20 + width] = 0.5, (0.6, 0.3, 0.3)
    shading[5:25, 20 : 20 + width] = 0.3
    mask = albedo[..., 0] > 0
    larger = tuple(np.repeat(np.repeat(one, 3, 0), 3, 1) for one in (albedo * shading, mask))
    fine, _ = at_full_resolution(albedo, mask, *larger, HOW)
    middle = fine[40:60, 60 + width : 60 + 2 * width]
    np.testing.assert_allclose(middle, np.broadcast_to([0.6, 0.3, 0.3], middle.shape), rtol=0.15)


def test_dark_pixels_and_outliers_are_held_back():
    truth, shading = painted()
    photo = truth * shading
    photo[30, 40] = 100.0
    photo[10, 10] = 0.0
    coarse = reduce_by_area(truth, (20, 28))
    fine, _ = at_full_resolution(coarse, photographed(coarse), photo, photographed(truth), HOW)
    assert np.isfinite(fine).all()
    assert fine.max() <= 4 * coarse.max()


def test_the_command_writes_the_photos_own_size(tmp_path, capsys):
    config = write_config(
        tmp_path / "scene.yaml",
        render=TINY | {"views": 2, "arc_deg": 20.0, "noise": 0.3, "width_px": 48, "height_px": 64},
        undistort={"max_size_px": 32},
        raycast={"reduce": 1},
    )
    code, _, said = unshade(capsys, "run", config, "--full-resolution")
    assert code == 0, said
    for name in ("000", "001"):
        small = read_exr(tmp_path / f"w/output/albedo/{name}.exr")
        large = read_exr(tmp_path / f"w/output/albedo_full/{name}.exr")
        assert small.shape == (32, 24, 3)
        assert large.shape == (64, 48, 3)
        back = reduce_by_area(large, small.shape[:2])
        inside = reduce_by_area((large.max(axis=2) > 0).astype(np.float32), small.shape[:2]) == 1
        assert inside.any()
        assert np.median(np.abs(back[inside] - small[inside])) < 0.15 * small[inside].mean()
        assert (tmp_path / f"w/output/albedo_full/{name}.png").is_file()
    code, said, _ = unshade(capsys, "plan", config, "--full-resolution")
    assert code == 0
    assert [line.split()[1] for line in said.splitlines() if line.startswith("full_resolution")] == ["reuse"]
    code, _, said = unshade(capsys, "plan", config, "--full-resolution", "--to", "raycast")
    assert code == 2
    assert "--to raycast" in said


@pytest.mark.parametrize("as_stored", [True, False])
def test_turned_photos_and_values_that_are_no_light_are_taken_as_undistort_takes_them(tmp_path, as_stored):
    """The same photo as stored or upright, with one firefly that must not become albedo."""
    light = (0.2 + 0.6 * RNG.random((40, 60, 3))).astype(np.float32)
    spiked = light.copy()
    spiked[7, 9] = 1e6
    write_raw_exr(tmp_path / "a.exr", spiked)
    exif = Image.Exif()
    exif[0x0112] = 3
    Image.fromarray(encode_srgb8(light)).save(tmp_path / "a.png", exif=exif)
    lens = {"model": "PINHOLE", "width": 60, "height": 40, "params": [50.0, 50.0, 30.0, 20.0]}
    camera = Camera("a", 30, 20, np.array([[25.0, 0, 15], [0, 25, 10], [0, 0, 1]]), np.eye(3, 4))
    write_exr(tmp_path / "albedo.exr", np.full((20, 30, 3), 0.5, np.float32))
    write_mask(tmp_path / "mask.png", np.ones((20, 30), bool))
    for name in ("a.exr", "a.png"):
        maps = tmp_path / "albedo.exr", tmp_path / "mask.png"
        view = View(
            of=PhotoAndAlbedo(tmp_path / name, name, as_stored, lens, camera, *maps),
            maps=tmp_path / f"{name}.fine.exr",
            pictures=tmp_path / f"{name}.fine.png",
            white=1.0,
            settings=HOW,
        )
        assert write_view(view) == "60x40"
    linear, photo = (read_exr(tmp_path / f"{name}.fine.exr") for name in ("a.exr", "a.png"))
    assert np.isfinite(linear).all() and (linear[7, 9] == 0).all()
    turned = photo if as_stored else photo[::-1, ::-1]
    known = (linear > 0).all(axis=2) & (turned > 0).all(axis=2)
    assert np.corrcoef(linear[known].ravel(), turned[known].ravel())[0, 1] > 0.99


def test_what_the_albedo_has_not_taken_over_stays_away_at_full_resolution_as_well():
    """The rim of a shadow, and noise on plain paint; beside them an edge of paint, as sharp as ever."""
    truth = np.full((120, 160, 3), 0.3, np.float32)
    truth[:, 120:] = [0.7, 0.5, 0.2]
    light = np.ones((120, 160, 1), np.float32)
    light[:, :41] = 0.4
    noise = 1 + 0.05 * np.random.default_rng(1).standard_normal((120, 160, 1))
    noise[:, :60] = 1
    noise[:, 100:] = 1
    photo = (truth * light * noise).astype(np.float32)
    coarse = reduce_by_area(truth, (30, 40))
    fine, _ = at_full_resolution(coarse, np.ones((30, 40), bool), photo, photographed(truth), HOW)

    def left(columns: slice) -> float:
        return float(np.std(np.log(fine[:, columns]))) / float(np.std(np.log(photo[:, columns])))

    assert left(slice(34, 48)) < 0.15
    assert left(slice(65, 95)) < 0.25
    assert np.abs(fine - truth)[:, 117:123].max() < 0.05
