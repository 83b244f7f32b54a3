"""Photos as cameras and telephones store them: raw and HEIF, decoded by their own libraries."""

from __future__ import annotations

import re
import sys

import numpy as np
import pillow_heif
import pytest
from PIL import Image, ImageCms

import stages
from pipeline import UserError
from pipeline.process.installation import install_extra
from stages.formats.colour.srgb import linear_from_srgb
from stages.formats.decoders.pictures import upright
from stages.formats.images.alpha import read_alpha
from stages.formats.images.exr import read_exr
from stages.formats.images.photo_folder import PHOTOS, find_photos, unread_photos
from stages.formats.images.photos import encode_srgb8, orientation_of, photo_size, read_photo
from stages.motion.photo_set import focal_prior, survey
from stages.motion.positions import position_of
from tests.test_undistort import lens_of, one_image_model, undistort
from tests.written_dng import NEUTRAL, write_dng

RNG = np.random.default_rng(3)
SMOOTH = np.stack(np.meshgrid(np.linspace(0.05, 0.9, 40), np.linspace(0.1, 0.8, 30)), axis=-1)
LINEAR = np.dstack([SMOOTH, 0.3 + 0.4 * SMOOTH[..., 0] * SMOOTH[..., 1]])  # of no more than a demosaic keeps


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_raw_is_developed_without_a_curve(tmp_path, orientation):
    write_dng(tmp_path / "a.dng", LINEAR, orientation)
    stored, turned = read_photo(tmp_path / "a.dng", as_stored=True), read_photo(tmp_path / "a.dng")
    assert stored.dtype == np.float32 and stored.shape == LINEAR.shape
    np.testing.assert_allclose(stored[2:-2, 2:-2], LINEAR[2:-2, 2:-2], atol=0.01)
    np.testing.assert_array_equal(turned, upright(stored, orientation))
    assert photo_size(tmp_path / "a.dng") == turned.shape[1::-1]
    assert photo_size(tmp_path / "a.dng", as_stored=True) == (40, 30)
    assert orientation_of(tmp_path / "a.dng") == orientation


def test_photos_of_a_camera_are_on_one_scale_whatever_it_measured(tmp_path):
    """Neither the camera's white balance nor the brightest pixel of a photo moves the others."""
    write_dng(tmp_path / "a.dng", LINEAR)
    write_dng(tmp_path / "b.dng", LINEAR, as_shot=NEUTRAL * (1.5, 1, 0.7))
    write_dng(tmp_path / "c.dng", 0.25 * LINEAR)
    a, b, c = (read_photo(tmp_path / f"{name}.dng") for name in "abc")
    np.testing.assert_array_equal(a, b)
    np.testing.assert_allclose(c, 0.25 * a, atol=0.004)


def test_what_saturates_the_sensor_is_white(tmp_path):
    bright = LINEAR.copy()
    bright[10:20, 10:20] = 3
    write_dng(tmp_path / "a.dng", bright)
    np.testing.assert_allclose(read_photo(tmp_path / "a.dng")[12:18, 12:18], 1, atol=0.001)


def heif(path, codes, **options):
    """Write codes losslessly: 4:4:4, as RGB."""
    mode = {3: "RGB", 4: "RGBA"}[codes.shape[2]] + (";16" if codes.dtype == np.uint16 else "")
    image = pillow_heif.from_bytes(mode, codes.shape[1::-1], codes.tobytes())
    image.save(path, quality=-1, chroma=444, matrix_coefficients=0, **options)


CODES = encode_srgb8(LINEAR)


@pytest.mark.parametrize("suffix", ["heic", "HEIF"])
def test_heif_is_decoded_as_any_photo(tmp_path, suffix):
    heif(tmp_path / f"a.{suffix}", CODES)
    assert photo_size(tmp_path / f"a.{suffix}") == (40, 30) and orientation_of(tmp_path / f"a.{suffix}") == 1
    found = read_photo(tmp_path / f"a.{suffix}")
    np.testing.assert_allclose(found, linear_from_srgb(CODES / 255), atol=0.005)
    assert read_alpha(tmp_path / f"a.{suffix}") is None


def test_heif_of_ten_bits_keeps_them(tmp_path):
    ramp = np.linspace(0, 1, 1024)[None, :, None] * np.ones((8, 1, 3))
    heif(tmp_path / "a.heic", np.rint(65535 * ramp).astype(np.uint16))
    found = read_photo(tmp_path / "a.heic")[4]
    assert len(np.unique(found[:, 1])) > 600  # eight bits have 256
    np.testing.assert_allclose(found, linear_from_srgb(ramp[4]), atol=0.006)


def test_the_profile_of_a_telephone_is_converted(tmp_path):
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    heif(tmp_path / "a.heic", CODES, icc_profile=profile)
    heif(tmp_path / "b.heic", CODES)
    np.testing.assert_allclose(read_photo(tmp_path / "a.heic"), read_photo(tmp_path / "b.heic"), atol=0.005)


def test_the_alpha_of_heif_is_a_mask(tmp_path):
    alpha = np.where(np.arange(40) < 20, 255, 0).astype(np.uint8) * np.ones((30, 1), np.uint8)
    heif(tmp_path / "a.heic", np.dstack([CODES, alpha]))
    np.testing.assert_array_equal(read_alpha(tmp_path / "a.heic"), alpha > 0)
    assert read_photo(tmp_path / "a.heic").shape == (30, 40, 3)


def test_exif_of_heif_tells_focal_length_and_position(tmp_path):
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 26
    exif.get_ifd(0x8825).update({1: "N", 2: (48.0, 12.0, 30.0), 3: "E", 4: (16.0, 22.0, 0.0)})
    heif(tmp_path / "a.heic", CODES, exif=exif.tobytes())
    assert focal_prior(tmp_path / "a.heic") == pytest.approx(26 / 35 * 40)
    where = position_of(tmp_path / "a.heic")
    assert (where.latitude, where.longitude) == pytest.approx((48 + 12.5 / 60, 16 + 22 / 60))


def test_avif_is_decoded_by_pillow(tmp_path):
    Image.fromarray(CODES).save(tmp_path / "a.avif", quality=100, subsampling="4:4:4")
    np.testing.assert_allclose(read_photo(tmp_path / "a.avif"), linear_from_srgb(CODES / 255), atol=0.03)


@pytest.mark.parametrize("name", ["a.dng", "a.nef", "a.heic", "a.avif"])
def test_what_is_none_of_its_kind_is_a_sentence(tmp_path, name):
    for data in (b"", b"not a photo at all", RNG.bytes(3000)):
        (tmp_path / name).write_bytes(data)
        for read in (read_photo, photo_size):
            with pytest.raises(UserError, match=rf"{name} cannot be read"):
                read(tmp_path / name)


@pytest.mark.parametrize("kind", ["dng", "heic"])
@pytest.mark.parametrize("kept", [0.3, 0.9])
def test_a_file_that_is_cut_off_is_a_sentence(tmp_path, kind, kept):
    path = tmp_path / f"a.{kind}"
    (write_dng if kind == "dng" else heif)(path, LINEAR if kind == "dng" else CODES)
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data))])
    with pytest.raises(UserError, match="cannot be read as"):
        read_photo(path)


@pytest.mark.parametrize(
    ("name", "module", "extra"), [("a.dng", "rawpy", "raw"), ("a.heic", "pi_heif", "heic")]
)
def test_a_missing_extra_is_named(tmp_path, monkeypatch, name, module, extra):
    (write_dng if extra == "raw" else heif)(tmp_path / name, LINEAR if extra == "raw" else CODES)
    Image.fromarray(CODES).save(tmp_path / "b.jpg")
    assert find_photos(tmp_path) == [name, "b.jpg"] and not unread_photos(tmp_path, [name, "b.jpg"])
    monkeypatch.setitem(sys.modules, module, None)  # as if it were not installed
    monkeypatch.setattr(
        "stages.formats.images.photo_folder.find_spec", lambda asked: None if asked == module else asked
    )
    with pytest.raises(UserError, match=re.escape(f"takes the extra `{extra}`: {install_extra(extra)}. Or ")):
        read_photo(tmp_path / name)
    assert find_photos(tmp_path) == ["b.jpg"]
    said = unread_photos(tmp_path, ["b.jpg"])
    assert f"holds 1 {name[1:]}, which takes the extra `{extra}`" in said


def test_what_a_camera_wrote_twice_is_read_once(tmp_path):
    Image.fromarray(CODES).save(tmp_path / "a.JPG")
    write_dng(tmp_path / "a.dng", LINEAR)
    write_dng(tmp_path / "b.dng", LINEAR)
    names = find_photos(tmp_path)
    assert names == ["a.JPG", "b.dng"] and unread_photos(tmp_path, names) == ""


@pytest.mark.parametrize("kind", ["dng", "heic"])
def test_the_stages_take_them_as_any_photo(make_job, tmp_path, kind):
    """Undistorted as the same light from an EXR, which is linear as well; found and measured for `sfm`."""
    model = one_image_model(f"{{}}.{kind}", lens_of("PINHOLE", 40, 30, 50, 50, 20, 15), 2)
    for index in range(2):
        if kind == "dng":
            write_dng(tmp_path / "photos" / f"{index}.dng", LINEAR)
        else:
            (tmp_path / "photos").mkdir(exist_ok=True)
            heif(tmp_path / "photos" / f"{index}.heic", CODES)
    done = undistort(make_job, tmp_path, model, tmp_path / "photos")
    assert done.warnings == []
    found = read_exr(done.outputs["linear"] / "0.exr")
    np.testing.assert_allclose(found[2:-2, 2:-2], LINEAR[2:-2, 2:-2], atol=0.012)
    photo = survey((f"0.{kind}", tmp_path / "copy.png"), tmp_path / "photos", 1600, 100)
    assert (photo.width, photo.height, photo.linear_sample) == (40, 30, None)


def test_the_key_of_a_result_knows_every_kind_of_photo():
    assert set(stages.IMAGE_SUFFIXES) == set(PHOTOS)
