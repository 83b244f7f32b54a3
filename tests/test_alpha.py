"""Alpha channels of every kind of photo, as masks; the same result as with masks of their own."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from PIL import Image

from pipeline import UserError
from stages.formats.images.alpha import read_alpha
from stages.formats.images.photos import read_mask, write_mask, write_png_srgb8
from stages.undistort import UndistortSettings
from tests.raw_exr import write_raw_exr
from tests.test_undistort import lens_of, one_image_model, undistort

RNG = np.random.default_rng(5)
CODES = RNG.integers(0, 256, (30, 40, 3), dtype=np.uint8)
ALPHA = np.where(np.arange(40) < 17, 255, 0).astype(np.uint8) * np.ones((30, 1), np.uint8)
ALPHA[4, 5], ALPHA[4, 30] = 127, 128  # just below half, and just above
OPAQUE = ALPHA >= 128
ORIENTED = {orientation: Image.Exif() for orientation in range(1, 9)}
for number, exif in ORIENTED.items():
    exif[0x0112] = number


def transparent_palette(path):
    """Of two hundred colours one is transparent."""
    picture = np.where(OPAQUE, CODES[..., 0] % 200, 200).astype(np.uint8)
    image = Image.fromarray(picture, "P")
    image.putpalette(RNG.integers(0, 256, 3 * 256, dtype=np.uint8).tolist())
    image.save(path, transparency=200)


def of_16_bits(path):
    values = np.dstack([CODES, ALPHA]).astype(np.uint16) * 257
    assert cv2.imwrite(str(path), values[..., [2, 1, 0, 3]])


WRITTEN = {
    "rgba.png": lambda path: Image.fromarray(np.dstack([CODES, ALPHA])).save(path),
    "grey.png": lambda path: Image.fromarray(np.dstack([CODES[..., 0], ALPHA]), "LA").save(path),
    "palette.png": transparent_palette,
    "deep.png": of_16_bits,
    "deep.tif": of_16_bits,
    "rgba.tif": lambda path: Image.fromarray(np.dstack([CODES, ALPHA])).save(path),
    "rgba.webp": lambda path: Image.fromarray(np.dstack([CODES, ALPHA])).save(path, lossless=True),
    "linear.exr": lambda path: write_raw_exr(path, np.dstack([CODES, ALPHA]).astype(np.float32) / 255),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_alpha_is_read_of_every_kind(tmp_path, name):
    WRITTEN[name](tmp_path / name)
    np.testing.assert_array_equal(read_alpha(tmp_path / name), OPAQUE)


@pytest.mark.parametrize("suffix", ["png", "jpg", "tif", "exr"])
def test_a_photo_without_alpha_or_opaque_has_no_mask(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    if suffix == "exr":
        write_raw_exr(path, np.dstack([CODES, np.full_like(ALPHA, 255)]).astype(np.float32) / 255)
    else:
        Image.fromarray(CODES).save(path)
    assert read_alpha(path) is None
    if suffix in ("png", "tif"):
        Image.fromarray(np.dstack([CODES, np.full_like(ALPHA, 255)])).save(path)
        assert read_alpha(path) is None


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_alpha_is_turned_as_its_photo(tmp_path, orientation, suffix):
    path = tmp_path / f"a.{suffix}"
    Image.fromarray(np.dstack([ALPHA, ALPHA, ALPHA, ALPHA])).save(path, exif=ORIENTED[orientation])
    np.testing.assert_array_equal(read_alpha(path, as_stored=True), OPAQUE)
    np.testing.assert_array_equal(read_alpha(path), read_mask(path))


def test_a_damaged_photo_is_a_sentence(tmp_path):
    Image.fromarray(np.dstack([CODES, ALPHA])).save(tmp_path / "a.png")
    (tmp_path / "a.png").write_bytes((tmp_path / "a.png").read_bytes()[:-900])
    with pytest.raises(UserError, match=r"a\.png cannot be read as an image"):
        read_alpha(tmp_path / "a.png")


def test_alpha_masks_as_a_mask_of_its_own_and_with_it(make_job, tmp_path):
    model = one_image_model("{}.png", lens_of("PINHOLE", 40, 30, 50, 50, 20, 15), 2)
    for index in range(2):
        (tmp_path / "alpha").mkdir(exist_ok=True)
        Image.fromarray(np.dstack([CODES, ALPHA])).save(tmp_path / "alpha" / f"{index}.png")
        write_png_srgb8(tmp_path / "plain" / f"{index}.png", CODES / 255.0)
        write_mask(tmp_path / "masks" / f"{index}.png", OPAQUE)
        write_mask(tmp_path / "upper" / f"{index}.png", np.arange(30)[:, None] * np.ones(40) < 12)

    def kept(out, images, settings=None, **inputs):
        done = undistort(make_job, tmp_path, model, tmp_path / images, settings, out=out, **inputs)
        return read_mask(done.outputs["kept"] / "0.png"), done.warnings

    by_alpha, said = kept("one", "alpha")
    by_mask, _ = kept("two", "plain", masks=tmp_path / "masks")
    np.testing.assert_array_equal(by_alpha, by_mask)
    assert said == []
    both, _ = kept("three", "alpha", masks=tmp_path / "upper")
    np.testing.assert_array_equal(both, by_mask & (np.arange(30) < 12)[:, None])
    ignored = undistort(
        make_job, tmp_path, model, tmp_path / "alpha", UndistortSettings(alpha=False), out="four"
    )
    assert not (ignored.outputs["kept"] / "0.png").exists()
    assert ignored.warnings == ["0.png, 1.png: an alpha channel: left out."]


def test_photos_that_are_transparent_everywhere_are_refused(make_job, tmp_path):
    model = one_image_model("{}.png", lens_of("PINHOLE", 40, 30, 50, 50, 20, 15), 2)
    (tmp_path / "images").mkdir()
    nothing = np.dstack([CODES, np.zeros_like(ALPHA)])
    for index in range(2):
        Image.fromarray(nothing if index else np.dstack([CODES, ALPHA])).save(
            tmp_path / "images" / f"{index}.png"
        )
    done = undistort(make_job, tmp_path, model, tmp_path / "images", out="one")
    assert done.warnings == ["1 of 2 photos are transparent everywhere: 1.png."]
    Image.fromarray(nothing).save(tmp_path / "images" / "0.png")
    with pytest.raises(UserError, match=r"transparent everywhere by their alpha.*undistort\.alpha=false"):
        undistort(make_job, tmp_path, model, tmp_path / "images", out="two")
