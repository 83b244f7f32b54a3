"""The door: every kind of file comes in as the same linear light, and what cannot be read is named."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import unicodedata
import zlib
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from PIL import Image, ImageOps

from pipeline import UserError
from stages.formats.colour.srgb import linear_from_srgb
from stages.formats.decoders.pictures import upright
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photo_folder import find_mask, find_photos, unread_photos
from stages.formats.images.photos import (
    encode_srgb8,
    encode_srgb16,
    photo_size,
    read_mask,
    read_photo,
    write_mask,
    write_png8,
    write_png_srgb8,
    write_png_srgb16,
)


@pytest.fixture
def codes() -> np.ndarray:
    """8-bit sRGB codes of an odd-sized picture without symmetries, (21, 34, 3)."""
    return np.random.default_rng(3).integers(0, 256, (21, 34, 3), dtype=np.uint8)


def touch(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")


def test_photos_are_found_in_subfolders_in_fixed_order_and_hidden_ones_are_not(tmp_path):
    touch(tmp_path, "b.JPG", "a b/é.Tiff", "c.exr", "K.txt", ".hidden.png", ".trash/x.png", "d.png.bak")
    assert find_photos(tmp_path) == ["a b/é.Tiff", "b.JPG", "c.exr"]


def test_photos_in_linked_folders_are_found(tmp_path):
    touch(tmp_path, "elsewhere/deep/b.jpg", "images/a.jpg")
    (tmp_path / "images/day 1").symlink_to(tmp_path / "elsewhere")
    assert find_photos(tmp_path / "images") == ["a.jpg", "day 1/deep/b.jpg"]


def test_a_link_that_leads_nowhere_is_named(tmp_path):
    (tmp_path / "a.jpg").symlink_to(tmp_path / "gone.jpg")
    with pytest.raises(UserError, match=r"a\.jpg is a link to .*gone\.jpg"):
        find_photos(tmp_path)


def test_a_photo_whose_name_is_not_utf_8_is_refused(tmp_path):
    try:
        Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9.jpg")).touch()
    except OSError:
        pytest.skip("this file system knows no such names")
    with pytest.raises(UserError, match=r"caf\\xe9\.jpg' is not called by a name in UTF-8"):
        find_photos(tmp_path)


def test_two_photos_of_one_view_name_are_refused_by_name(tmp_path):
    touch(tmp_path, "s/a.jpg", "s/a.PNG")
    with pytest.raises(UserError, match=r"s/a\.PNG and s/a\.jpg .* extension"):
        find_photos(tmp_path)


def test_photos_whose_extra_is_missing_are_counted_unless_they_lie_there_in_another(tmp_path, monkeypatch):
    monkeypatch.setattr("stages.formats.images.photo_folder.find_spec", lambda module: None)
    touch(tmp_path, "a.jpg", "a.CR2", "b.NEF", "s/c.nef", "d.heic", ".hidden.dng", "K.txt")
    sentence = unread_photos(tmp_path, find_photos(tmp_path))
    assert f"{tmp_path} holds 1 .heic, which takes the extra `heic`" in sentence
    assert f"{tmp_path} holds 2 .nef, which takes the extra `raw`" in sentence
    assert unread_photos(tmp_path, ["a.jpg", "b.jpg", "s/c.jpg", "d.png"]) == ""


def test_a_missing_folder_is_said(tmp_path):
    with pytest.raises(UserError, match="no folder of photos at .*nowhere"):
        find_photos(tmp_path / "nowhere")


def test_eight_bits_become_linear_light_by_the_srgb_curve(tmp_path):
    """Hand-computed: code 188 is 0.737255 encoded, ((0.737255 + 0.055) / 1.055)^2.4 = 0.502886 linear."""
    Image.fromarray(np.full((2, 3, 3), 188, np.uint8)).save(tmp_path / "g.png")
    linear = read_photo(tmp_path / "g.png")
    assert linear.dtype == np.float32 and linear.shape == (2, 3, 3)
    np.testing.assert_allclose(linear, 0.502886, atol=1e-6)


@pytest.mark.parametrize("name", ["p.png", "p.tif", "p.TIFF"])
def test_eight_bits_survive_the_way_in_and_out(tmp_path, codes, name):
    Image.fromarray(codes).save(tmp_path / name, format="PNG" if name == "p.png" else "TIFF")
    np.testing.assert_array_equal(encode_srgb8(read_photo(tmp_path / name)), codes)
    assert photo_size(tmp_path / name) == (34, 21)


@pytest.mark.parametrize("name", ["deep.png", "deep.tif"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_sixteen_bits_are_not_cut_to_eight(tmp_path, name, channels):
    deep = np.random.default_rng(4).integers(0, 65536, (9, 14, channels), dtype=np.uint16)
    bgr = deep if channels == 1 else deep[..., [2, 1, 0, 3][:channels]]
    (tmp_path / name).write_bytes(cv2.imencode(Path(name).suffix, bgr)[1].tobytes())
    expected = np.repeat(deep, 3, axis=2) if channels == 1 else deep[..., :3]
    np.testing.assert_array_equal(encode_srgb16(read_photo(tmp_path / name)), expected)


def test_grey_palette_alpha_and_two_levels_become_rgb(tmp_path, codes):
    grey = Image.fromarray(codes[..., 0])
    grey.save(tmp_path / "grey.png")
    np.testing.assert_array_equal(
        encode_srgb8(read_photo(tmp_path / "grey.png")), np.repeat(codes[..., :1], 3, axis=2)
    )
    palette = Image.fromarray(codes).quantize(16)
    palette.save(tmp_path / "palette.png")
    np.testing.assert_array_equal(encode_srgb8(read_photo(tmp_path / "palette.png")), palette.convert("RGB"))
    Image.fromarray(np.dstack([codes, codes[..., 0]])).save(tmp_path / "alpha.png")
    np.testing.assert_array_equal(encode_srgb8(read_photo(tmp_path / "alpha.png")), codes)
    Image.fromarray(codes[..., 0] > 127).save(tmp_path / "levels.png")
    assert set(np.unique(read_photo(tmp_path / "levels.png"))) == {0.0, 1.0}


def test_cmyk_is_converted(tmp_path):
    Image.new("CMYK", (8, 8), (0, 255, 255, 0)).save(tmp_path / "ink.jpg", quality=100)
    red = encode_srgb8(read_photo(tmp_path / "ink.jpg"))[4, 4]
    assert red[0] > 240 and red[1] < 15 and red[2] < 15


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("extension", ["jpg", "png", "tif"])
def test_exif_orientation_is_applied_as_pillow_does(tmp_path, codes, orientation, extension):
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / f"turned.{extension}"
    Image.fromarray(codes).save(path, exif=exif)
    expected = np.asarray(ImageOps.exif_transpose(Image.open(path)))
    np.testing.assert_array_equal(encode_srgb8(read_photo(path)), expected)
    assert photo_size(path) == expected.shape[1::-1]


def exif_orientation(kind: int, value: bytes, data: bytes = b"") -> bytes:
    """An EXIF block that holds nothing but an orientation of any TIFF type; `data` begins at offset 26."""
    entry = struct.pack("<HHHI", 1, 0x0112, kind, 1) + value.ljust(4, b"\0")
    return b"Exif\0\0II*\0" + struct.pack("<I", 8) + entry + bytes(4) + data


@pytest.mark.parametrize("extension", ["jpg", "png"])
@pytest.mark.parametrize(
    "exif",
    [
        exif_orientation(2, b"6"),
        exif_orientation(7, b"\x06"),
        exif_orientation(5, struct.pack("<I", 26), struct.pack("<II", 6, 0)),
        exif_orientation(3, struct.pack("<H", 9)),
        exif_orientation(3, struct.pack("<H", 0)),
    ],
    ids=["text", "bytes", "6/0", "9", "0"],
)
def test_an_orientation_that_is_none_counts_as_upright(tmp_path, codes, extension, exif):
    path = tmp_path / f"odd.{extension}"
    Image.fromarray(codes).save(path, exif=exif)
    assert photo_size(path) == (34, 21)
    np.testing.assert_array_equal(encode_srgb8(read_photo(path)), np.asarray(Image.open(path)))


def test_exif_that_cannot_be_read_is_named(tmp_path, codes):
    Image.fromarray(codes).save(tmp_path / "odd.png", exif=b"Exif\0\0no exif at all")
    with pytest.raises(UserError, match=r"odd\.png cannot be read .*remove it"):
        photo_size(tmp_path / "odd.png")


def test_orientations_by_hand():
    """Row 0 is the right side in orientation 6 (turn clockwise), the left side in 8."""
    image = np.array([[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(upright(image, 6), [[4, 1], [5, 2], [6, 3]])
    np.testing.assert_array_equal(upright(image, 8), [[3, 6], [2, 5], [1, 4]])
    np.testing.assert_array_equal(upright(image, 3), [[6, 5, 4], [3, 2, 1]])


def test_linear_files_come_as_they_are(tmp_path):
    light = np.random.default_rng(5).random((7, 11, 3)).astype(np.float32) * 40
    write_exr(tmp_path / "light.exr", light)
    np.testing.assert_array_equal(read_photo(tmp_path / "light.exr"), light)
    (tmp_path / "light.hdr").write_bytes(cv2.imencode(".hdr", light[..., ::-1])[1].tobytes())
    np.testing.assert_allclose(read_photo(tmp_path / "light.hdr"), light, atol=40 / 128)
    assert photo_size(tmp_path / "light.exr") == photo_size(tmp_path / "light.hdr") == (11, 7)
    write_exr(tmp_path / "grey.exr", light[..., 0])
    assert read_photo(tmp_path / "grey.exr").shape == (7, 11, 3)


@pytest.mark.parametrize("types", [(np.float32,) * 3, (np.float16, np.float32, np.float32), (np.uint32,) * 3])
@pytest.mark.parametrize("further", [(), ("A",), ("A", "Z"), ("Z", "left.R", "left.G", "left.B")])
def test_colours_of_an_exr_are_found_whatever_their_types_and_beside_other_channels(tmp_path, types, further):
    values = {
        name: 10 * n + np.arange(12.0).reshape(3, 4) for n, name in enumerate(("R", "G", "B", *further))
    }
    channels = {name: own.astype(types[n % 3]) for n, (name, own) in enumerate(values.items())}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(
        read_exr(tmp_path / "a.exr"), np.stack([values[name] for name in "RGB"], axis=-1)
    )


@pytest.mark.parametrize("extension", ["jpg", "png", "tif"])
@pytest.mark.parametrize("share", [0.0, 0.03, 0.5, 0.9])
def test_truncated_files_are_named(tmp_path, codes, extension, share):
    path = tmp_path / f"cut.{extension}"
    Image.fromarray(codes).save(path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(UserError, match=rf"cut\.{extension} cannot be read .*remove it"):
        read_photo(path)


def test_truncated_sixteen_bits_and_exr_are_named(tmp_path, capfd):
    deep = np.random.default_rng(6).integers(0, 65536, (60, 60, 3), dtype=np.uint16)
    (tmp_path / "cut.png").write_bytes(cv2.imencode(".png", deep)[1].tobytes()[:9000])
    write_exr(tmp_path / "cut.exr", deep.astype(np.float32))
    (tmp_path / "cut.exr").write_bytes((tmp_path / "cut.exr").read_bytes()[:9000])
    for name in ("cut.png", "cut.exr"):
        with pytest.raises(UserError, match=rf"{name} cannot be read"):
            read_photo(tmp_path / name)


def test_a_text_file_called_jpg_is_named(tmp_path):
    (tmp_path / "note.jpg").write_text("not a photo")
    with pytest.raises(UserError, match=r"note\.jpg cannot be read as an image \(not an image"):
        read_photo(tmp_path / "note.jpg")


def test_a_decompression_bomb_is_refused_before_anything_is_allocated(tmp_path):
    """A few bytes of PNG that claim 60000 × 60000 pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 60000, 60000, 8, 2, 0, 0, 0)
    bomb = (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b""))
        + chunk(b"IEND", b"")
    )
    (tmp_path / "bomb.png").write_bytes(bomb)
    with pytest.raises(UserError, match="60000 × 60000 pixels, more than the 256 megapixels"):
        read_photo(tmp_path / "bomb.png")


def test_png_keeps_sixteen_bits_and_creates_folders(tmp_path):
    linear = np.random.default_rng(7).random((5, 6, 3), np.float32)
    path = tmp_path / "neu er" / "ü.png"
    write_png_srgb16(path, linear)
    np.testing.assert_allclose(read_photo(path), linear, atol=4e-5)
    write_png_srgb8(path, linear)
    np.testing.assert_allclose(read_photo(path), linear, atol=5e-3)
    write_png_srgb16(path, linear[..., 0])
    np.testing.assert_allclose(read_photo(path)[..., 1], linear[..., 0], atol=4e-5)


def test_png_of_values_as_they_are_is_rgb(tmp_path, codes):
    write_png8(tmp_path / "raw.png", codes)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "raw.png")), codes)


def test_encoding_clips_and_rounds():
    np.testing.assert_array_equal(encode_srgb8(np.array([-1, 0, 1, 7.0])), [0, 0, 255, 255])
    np.testing.assert_array_equal(encode_srgb8(linear_from_srgb(np.arange(256) / 255)), np.arange(256))


def test_masks_survive_and_any_kind_of_white_counts(tmp_path):
    mask = np.random.default_rng(8).random((9, 5)) > 0.5
    write_mask(tmp_path / "m" / "a.png", mask)
    np.testing.assert_array_equal(read_mask(tmp_path / "m" / "a.png"), mask)
    Image.fromarray(mask).save(tmp_path / "levels.png")
    Image.fromarray(np.where(mask, 65535, 0).astype(np.uint16)).save(tmp_path / "deep.png")
    Image.fromarray(np.repeat(np.where(mask, 200, 90)[..., None], 3, 2).astype(np.uint8)).save(
        tmp_path / "g.png"
    )
    for name in ("levels.png", "deep.png", "g.png"):
        np.testing.assert_array_equal(read_mask(tmp_path / name), mask)


def test_masks_are_found_by_three_names(tmp_path):
    touch(tmp_path, "a.jpg", "s/b.png", "s/c.jpg.png")
    assert find_mask(tmp_path, "a.jpg") == tmp_path / "a.jpg"
    assert find_mask(tmp_path, "s/b.jpg") == tmp_path / "s/b.png"
    assert find_mask(tmp_path, "s/c.jpg") == tmp_path / "s/c.jpg.png"
    assert find_mask(tmp_path, "d.jpg") is None


def test_accents_may_be_spelled_in_two_ways(tmp_path):
    """As on a Mac's disk, and as typed: masks belong to photos all the same, and two photos are one view."""
    composed, decomposed = (unicodedata.normalize(form, "é") for form in ("NFC", "NFD"))
    assert composed != decomposed
    touch(tmp_path / "m", f"{decomposed}.png")
    assert find_mask(tmp_path / "m", f"{composed}.jpg") == tmp_path / "m" / f"{decomposed}.png"
    touch(tmp_path / "p", f"{composed}.jpg", f"{decomposed}.jpg")
    with pytest.raises(UserError, match="how their accents are spelled"):
        find_photos(tmp_path / "p")


def test_pycolmap_before_opencv_does_not_corrupt_png(tmp_path):
    """In a fresh interpreter, as a stage imports them: without zlib loaded first, this aborts."""
    program = (
        "import stages, pycolmap, cv2, numpy as np\n"
        "noise = np.random.default_rng(0).integers(0, 256, (512, 768, 3)).astype(np.uint8)\n"
        "assert all(cv2.imdecode(cv2.imencode('.png', noise)[1], 1).shape == noise.shape for _ in range(3))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()[:300]


def test_webp_is_read_as_png_is_and_found_beside_it(tmp_path, codes):
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(codes).save(tmp_path / "a.webp", lossless=True, exact=True)
    Image.fromarray(codes).save(tmp_path / "b.png")
    Image.fromarray(codes).save(tmp_path / "c.webp", lossless=True, exact=True, exif=exif)
    assert find_photos(tmp_path) == ["a.webp", "b.png", "c.webp"]
    np.testing.assert_array_equal(read_photo(tmp_path / "a.webp"), read_photo(tmp_path / "b.png"))
    np.testing.assert_array_equal(
        read_photo(tmp_path / "c.webp"), np.rot90(read_photo(tmp_path / "b.png"), -1)
    )
    (tmp_path / "cut.webp").write_bytes((tmp_path / "a.webp").read_bytes()[:-40])
    with pytest.raises(UserError, match="cut.webp cannot be read"):
        read_photo(tmp_path / "cut.webp")
