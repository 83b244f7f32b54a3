"""What headers say and decoders pass over is said; what neither can deliver is refused; turned photos fit."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pycolmap
import pytest
import tifffile
from PIL import Image, ImageCms

from pipeline import UserError
from stages.adopt_model import ADOPT_MODEL, AdoptModelSettings
from stages.formats.colour.srgb import linear_from_srgb
from stages.formats.decoders.pictures import upright
from stages.formats.decoders.png_chunks import chunks_before_pixels
from stages.formats.images.exr import write_exr
from stages.formats.images.masked_photos import read_masked_photo
from stages.formats.images.photo_remarks import remarks_on
from stages.formats.images.photo_settings import FireflySettings
from stages.formats.images.photo_turns import read_as_stored, write_as_stored
from stages.formats.images.photos import (
    encode_srgb8,
    photo_size,
    read_photo,
    write_png8,
    write_png_srgb8,
    write_png_srgb16,
)
from stages.undistort import UNDISTORT, UndistortSettings
from tests.raw_exr import write_raw_exr

CODES = np.random.default_rng(0).integers(0, 256, (30, 40, 3)).astype(np.uint8)
INVERSE = {1: 1, 2: 2, 3: 3, 4: 4, 5: 5, 6: 8, 7: 7, 8: 6}


def profile_named(name: str, srgb: bool = False) -> bytes:
    """ICC's own sRGB, renamed in its `desc` tag; where it is not to be sRGB, red and green are exchanged.

    Then its connection space is said to be Lab, too, which a profile of a matrix cannot have: it is not read.
    """
    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    count = struct.unpack_from(">I", profile, 128)[0]
    text = name.encode("utf-16-be")
    for k in range(count):
        tag, offset, _ = struct.unpack_from(">4sII", profile, 132 + 12 * k)
        if not srgb and tag in (b"rXYZ", b"gXYZ"):
            struct.pack_into(">4s", profile, 132 + 12 * k, b"gXYZ" if tag == b"rXYZ" else b"rXYZ")
        if tag == b"desc":
            assert profile[offset : offset + 4] == b"mluc"
            start = len(profile)
            profile += text
            struct.pack_into(">II", profile, offset + 20, len(text), start - offset)
            struct.pack_into(">4sII", profile, 132 + 12 * k, b"desc", offset, start - offset + len(text))
    struct.pack_into(">I", profile, 0, len(profile))
    if not srgb:
        profile[20:24] = b"Lab "
    return bytes(profile)


def tagged(path: Path, orientation: int) -> Path:
    """A photo whose header says how it is turned; its pixels are stored as CODES."""
    exif = Image.Exif()
    exif[0x0112] = orientation
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(CODES).save(path, exif=exif)
    return path


@pytest.mark.parametrize("name", ["Adobe RGB (1998)", "Display P3", "ProPhoto RGB"])
@pytest.mark.parametrize("suffix", ["jpg", "png", "tif"])
def test_an_embedded_profile_is_named(tmp_path, name, suffix):
    path = tmp_path / f"a.{suffix}"
    Image.fromarray(CODES).save(path, icc_profile=profile_named(name))
    assert remarks_on(path, False, False) == [f"an embedded profile ({name}): taken as sRGB"]


def test_srgb_and_no_profile_need_no_word(tmp_path):
    Image.fromarray(CODES).save(tmp_path / "a.jpg", icc_profile=profile_named("c2", srgb=True))
    Image.fromarray(CODES).save(tmp_path / "b.png")
    assert remarks_on(tmp_path / "a.jpg", False, False) == remarks_on(tmp_path / "b.png", False, False) == []
    Image.fromarray(CODES).save(tmp_path / "d.jpg", icc_profile=profile_named("sRGB, or so it says"))
    assert "(sRGB, or so it says): taken as sRGB" in remarks_on(tmp_path / "d.jpg", False, False)[0]
    Image.fromarray(CODES).save(tmp_path / "c.jpg", icc_profile=b"no profile at all")
    assert remarks_on(tmp_path / "c.jpg", False, False) == [
        "an embedded profile (which cannot be read): taken as sRGB"
    ]


def test_alpha_frames_cmyk_and_gamma_are_named(tmp_path):
    Image.fromarray(np.dstack([CODES, CODES[..., 0]])).save(tmp_path / "alpha.png")
    assert remarks_on(tmp_path / "alpha.png", False, False) == ["an alpha channel: left out"]
    Image.fromarray(CODES).save(tmp_path / "two.tif", save_all=True, append_images=[Image.fromarray(CODES)])
    assert remarks_on(tmp_path / "two.tif", False, False) == ["2 pictures in one file: the first is taken"]
    Image.fromarray(CODES).convert("CMYK").save(tmp_path / "ink.jpg")
    assert remarks_on(tmp_path / "ink.jpg", False, False) == ["CMYK: converted without a profile"]
    plain = cv2.imencode(".png", CODES)[1].tobytes()
    gamma = b"gAMA" + struct.pack(">I", 100000)
    import zlib

    chunk = struct.pack(">I", 4) + gamma + struct.pack(">I", zlib.crc32(gamma))
    (tmp_path / "gamma.png").write_bytes(plain[:33] + chunk + plain[33:])
    assert remarks_on(tmp_path / "gamma.png", False, False) == ["a gamma of 1: taken as sRGB"]


def test_what_an_exr_says_is_named(tmp_path):
    acescg = np.array([0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767], np.float32)
    light = np.ones((6, 8, 4), np.float32)
    write_raw_exr(tmp_path / "a.exr", light, chromaticities=tuple(map(float, acescg)))
    found = remarks_on(tmp_path / "a.exr", False, False)
    assert found == [
        "other primaries than sRGB's (chromaticities): taken as sRGB's",
        "an alpha channel: left out",
    ]
    write_raw_exr(tmp_path / "b.exr", light[..., :3])
    assert remarks_on(tmp_path / "b.exr", False, False) == []


@pytest.mark.parametrize("dtype", [np.int32, np.uint32, np.int16, np.float32])
def test_a_tiff_that_no_decoder_brings_to_light_is_refused(tmp_path, dtype):
    """A TIFF of 32 bits once became white."""
    path = tmp_path / "deep.tif"
    if dtype is np.float32:
        Image.fromarray(CODES[..., 0].astype(np.float32)).save(path)
    else:
        _write_grey_tiff(path, CODES[..., 0].astype(dtype))
    with pytest.raises(UserError, match=r"deep\.tif is a .*xport it"):
        read_photo(path)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_tiff_whose_channels_stand_apart_is_read_or_refused(tmp_path, dtype):
    """OpenCV takes the channels of 16 bits for interleaved: all were the first."""
    values = np.random.default_rng(1).integers(0, 255, (9, 14, 3)).astype(dtype)
    planes = np.moveaxis(values, -1, 0)
    tifffile.imwrite(tmp_path / "a.tif", planes, planarconfig="separate", photometric="rgb")
    if dtype == np.uint16:
        with pytest.raises(UserError, match=r"channels stand one after the other .*export it with inter"):
            read_photo(tmp_path / "a.tif")
    else:
        np.testing.assert_allclose(read_photo(tmp_path / "a.tif"), linear_from_srgb(values / 255), atol=1e-6)


def _write_grey_tiff(path: Path, values: np.ndarray) -> None:
    """By hand: little-endian, one strip, as scientific cameras write it."""
    height, width = values.shape
    data = values.astype(values.dtype.newbyteorder("<")).tobytes()
    bits, signed = 8 * values.dtype.itemsize, 2 if np.issubdtype(values.dtype, np.signedinteger) else 1
    tags = [(256, width), (257, height), (258, bits), (259, 1), (262, 1), (273, 8), (277, 1), (278, height)]
    tags += [(279, len(data)), (339, signed)]
    table = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    header = struct.pack("<2sHI", b"II", 42, 8 + len(data))
    path.write_bytes(header + data + struct.pack("<H", len(tags)) + table + struct.pack("<I", 0))


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", ["jpg", "png", "tif"])
def test_as_stored_is_upright_turned_back(tmp_path, orientation, suffix):
    path = tagged(tmp_path / f"a.{suffix}", orientation)
    stored, turned = read_photo(path, as_stored=True), read_photo(path)
    assert photo_size(path, as_stored=True) == (40, 30) == stored.shape[1::-1]
    assert photo_size(path) == turned.shape[1::-1]
    np.testing.assert_array_equal(upright(stored, orientation), turned)
    np.testing.assert_array_equal(upright(turned, INVERSE[orientation]), stored)
    if suffix != "jpg":
        np.testing.assert_array_equal(encode_srgb8(stored), CODES)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("channels", [1, 4])
def test_a_plain_tiff_is_turned_as_any_other(tmp_path, orientation, channels):
    """Pillow maps these into memory, in rows of the wrong length where they are turned by 90°."""
    exif = Image.Exif()
    exif[0x0112] = orientation
    grey = np.repeat(CODES[..., :1], 3, axis=2)
    pixels = CODES[..., 0] if channels == 1 else np.dstack([CODES, np.full(CODES.shape[:2], 255, np.uint8)])
    Image.fromarray(pixels).save(tmp_path / "a.tif", exif=exif)
    turned = upright(grey if channels == 1 else CODES, orientation)
    np.testing.assert_array_equal(encode_srgb8(read_photo(tmp_path / "a.tif")), turned)


@pytest.mark.parametrize("orientation", [1, 3, 6, 8, 2])
def test_a_photo_meets_its_camera_as_colmap_saw_it(make_job, tmp_path, orientation):
    """COLMAP passes over the tag: pixels and camera must be of one image. 180° once were two."""
    tagged(tmp_path / "images/a.png", orientation)
    model = pycolmap.Reconstruction()
    lens = pycolmap.Camera(camera_id=1, model="PINHOLE", width=40, height=30, params=[50.0, 50, 20, 15])
    model.add_camera_with_trivial_rig(lens)
    model.add_image_with_trivial_frame(
        pycolmap.Image(name="a.png", camera_id=1, image_id=1), pycolmap.Rigid3d()
    )
    (tmp_path / "model").mkdir()
    model.write(tmp_path / "model")
    adopted = make_job(
        tmp_path / "adopted", ADOPT_MODEL, colmap=tmp_path / "model", images=tmp_path / "images"
    )
    ADOPT_MODEL.run(adopted)
    assert read_as_stored(adopted.outputs["model"]) == ({"a.png"} if orientation != 1 else set())
    settings = UndistortSettings(max_size_px=None)
    job = make_job(
        tmp_path / "out", UNDISTORT, settings, images=tmp_path / "images", model=adopted.outputs["model"]
    )
    UNDISTORT.run(job)
    image = np.asarray(Image.open(job.outputs["workspace"] / "images/a.png"))
    np.testing.assert_array_equal(image, CODES)
    assert (job.facts.get("headers") is None) == (orientation == 1)
    if orientation == 3:
        assert job.warnings == ["a.png: turned by 180° by its tag: taken as stored, as COLMAP does."]


def test_a_mask_is_turned_as_its_photo_is(make_job, tmp_path):
    """Both with the same tag, both stored alike: the mask once covered the wrong half."""
    mask = np.zeros((30, 40), np.uint8)
    mask[:10] = 255
    exif = Image.Exif()
    exif[0x0112] = 3
    tagged(tmp_path / "a.png", 3)
    Image.fromarray(mask).save(tmp_path / "m.png", exif=exif)
    for as_stored in (True, False):
        linear, kept, _ = read_masked_photo(
            tmp_path / "a.png", tmp_path / "m.png", (40, 30), as_stored, True, float("inf"), FireflySettings()
        )
        assert kept[:10].all() == as_stored and kept[20:].all() == (not as_stored)
        np.testing.assert_array_equal(
            encode_srgb8(linear[kept]), CODES[:10].reshape(-1, 3)[:: 1 if as_stored else -1]
        )


@pytest.mark.parametrize(
    ("told", "turned"), [(None, True), ([], False), (["a.png"], True), ("upright", False)]
)
def test_who_says_how_a_turned_photo_is_meant(make_job, tmp_path, told, turned):
    """A model of our own knows; of another's, COLMAP's habit is taken, unless a setting says otherwise."""
    tagged(tmp_path / "images/a.png", 3)
    model = pycolmap.Reconstruction()
    lens = pycolmap.Camera(camera_id=1, model="PINHOLE", width=40, height=30, params=[50.0, 50, 20, 15])
    model.add_camera_with_trivial_rig(lens)
    image = pycolmap.Image(name="a.png", camera_id=1, image_id=1)
    model.add_image_with_trivial_frame(image, pycolmap.Rigid3d())
    (tmp_path / "model").mkdir()
    model.write(tmp_path / "model")
    if isinstance(told, list):
        write_as_stored(tmp_path / "model", told)
    settings = AdoptModelSettings(turned_photos="upright" if told == "upright" else "as_stored")
    places = {"colmap": tmp_path / "model", "images": tmp_path / "images"}
    adopted = make_job(tmp_path / "adopted", ADOPT_MODEL, settings, **places)
    ADOPT_MODEL.run(adopted)
    assert (read_as_stored(adopted.outputs["model"]) == {"a.png"}) == turned


def test_png_and_hdr_say_more_than_pillow_tells(tmp_path):
    import zlib

    def with_chunk(name: bytes, data: bytes) -> bytes:
        plain = cv2.imencode(".png", CODES)[1].tobytes()
        body = name + data
        return (
            plain[:33]
            + struct.pack(">I", len(data))
            + body
            + struct.pack(">I", zlib.crc32(body))
            + plain[33:]
        )

    (tmp_path / "a.png").write_bytes(with_chunk(b"cICP", bytes([9, 16, 0, 1])))
    assert remarks_on(tmp_path / "a.png", False, False) == ["a coding of [9, 16, 0, 1] (cICP): taken as sRGB"]
    (tmp_path / "b.png").write_bytes(with_chunk(b"cICP", bytes([1, 13, 0, 1])))
    assert remarks_on(tmp_path / "b.png", False, False) == []
    adobe = [31270, 32900, 64000, 33000, 21000, 71000, 15000, 6000]
    (tmp_path / "c.png").write_bytes(with_chunk(b"cHRM", struct.pack(">8I", *adobe)))
    assert remarks_on(tmp_path / "c.png", False, False) == [
        "other primaries than sRGB's (cHRM): taken as sRGB's"
    ]
    srgb = [31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000]
    (tmp_path / "d.png").write_bytes(with_chunk(b"cHRM", struct.pack(">8I", *srgb)))
    assert remarks_on(tmp_path / "d.png", False, False) == []
    hdr = cv2.imencode(".hdr", CODES.astype(np.float32))[1].tobytes()
    (tmp_path / "e.hdr").write_bytes(hdr.replace(b"\n\n", b"\nEXPOSURE=4.0\n\n", 1))
    assert remarks_on(tmp_path / "e.hdr", False, False) == ["EXPOSURE=4.0: left out"]


def test_photos_that_say_the_same_share_a_line_and_each_has_its_own_in_the_record(make_job, tmp_path):
    model = pycolmap.Reconstruction()
    lens = pycolmap.Camera(camera_id=1, model="PINHOLE", width=40, height=30, params=[50.0, 50, 20, 15])
    model.add_camera_with_trivial_rig(lens)
    (tmp_path / "images").mkdir()
    for k in range(3):
        name = f"{k}.png"
        profile = profile_named("Adobe RGB (1998)") if k < 2 else None
        Image.fromarray(CODES).save(tmp_path / "images" / name, icc_profile=profile)
        image = pycolmap.Image(name=name, camera_id=1, image_id=k + 1)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d())
    (tmp_path / "model").mkdir()
    model.write(tmp_path / "model")
    job = make_job(tmp_path / "out", UNDISTORT, images=tmp_path / "images", model=tmp_path / "model")
    UNDISTORT.run(job)
    said = "an embedded profile (Adobe RGB (1998)): taken as sRGB"
    assert job.warnings == [f"0.png, 1.png: {said}."]
    assert job.facts["headers"] == {"0.png": said, "1.png": said}
    assert json.dumps(job.facts)


def test_what_is_written_says_its_colours(tmp_path):
    linear = linear_from_srgb(CODES / 255)
    write_png_srgb8(tmp_path / "a.png", linear)
    write_png_srgb16(tmp_path / "b.png", linear)
    write_png8(tmp_path / "c.png", CODES)  # values that are no colours
    for name in "ab":
        chunks = chunks_before_pixels(tmp_path / f"{name}.png")
        assert {b"sRGB", b"gAMA", b"cHRM"} <= chunks.keys()
        with Image.open(tmp_path / f"{name}.png") as image:
            image.verify()  # checksums
            assert image.info["srgb"] == 0 and image.info["gamma"] == pytest.approx(1 / 2.2, abs=1e-4)
            assert image.info["chromaticity"][2:4] == pytest.approx((0.64, 0.33))
        assert remarks_on(tmp_path / f"{name}.png", False, True) == []
    assert b"sRGB" not in chunks_before_pixels(tmp_path / "c.png")
    np.testing.assert_array_equal(encode_srgb8(read_photo(tmp_path / "a.png")), CODES)


@pytest.mark.parametrize(("shape", "is_colour"), [((6, 8, 3), True), ((6, 8, 3), False), ((6, 8), True)])
def test_an_exr_says_its_primaries_if_it_holds_colours(tmp_path, shape, is_colour):
    write_exr(tmp_path / "a.exr", np.ones(shape, np.float32), is_colour=is_colour)
    with OpenEXR.File(str(tmp_path / "a.exr"), header_only=True) as file:
        header = dict(file.header())
    if len(shape) == 3 and is_colour:
        assert np.ravel(header["chromaticities"]) == pytest.approx(
            (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
        )
        assert remarks_on(tmp_path / "a.exr", False, True) == []
    else:
        assert "chromaticities" not in header
