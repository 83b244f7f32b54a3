"""Embedded profiles: what a library of colour management says, at 8 and 16 bits, and what is left to sRGB."""

from __future__ import annotations

import struct
from io import BytesIO

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, ImageCms

from stages.formats.colour.icc_profiles import SRGB_IN_D50, read_profile
from stages.formats.colour.srgb import linear_from_srgb
from stages.formats.images.photo_remarks import remarks_on
from stages.formats.images.photos import encode_srgb8, read_photo

# Colorants adapted to D50, as the profiles of these names have them.
ADOBE = np.array([[0.60974, 0.20528, 0.14919], [0.31111, 0.62567, 0.06322], [0.01947, 0.06087, 0.74457]])
P3 = np.array([[0.51512, 0.29198, 0.1571], [0.2412, 0.69225, 0.06657], [-0.00105, 0.04189, 0.78407]])
PROPHOTO = np.array([[0.7977, 0.1352, 0.0313], [0.288, 0.7119, 0.0001], [0.0, 0.0, 0.8249]])
CODES = np.random.default_rng(0).integers(60, 200, (20, 30, 3)).astype(np.uint8)
GAMMA = b"curv" + bytes(4) + struct.pack(">IH", 1, round(2.2 * 256))
OF_SRGB = (
    b"para"
    + bytes(4)
    + struct.pack(
        ">HH5i", 3, 0, *(round(65536 * v) for v in (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045))
    )
)
SAMPLED = (
    b"curv"
    + bytes(4)
    + struct.pack(">I", 256)
    + np.rint(65535 * (np.arange(256) / 255) ** 1.8).astype(">u2").tobytes()
)


def s15(*values: float) -> bytes:
    return struct.pack(f">{len(values)}i", *(round(65536 * value) for value in values))


def profile(space: bytes, tags: dict[bytes, bytes], connection: bytes = b"XYZ ") -> bytes:
    """A display profile of version 4 with these tags, which littleCMS opens as well."""
    name = "made".encode("utf-16-be")
    text = b"mluc" + bytes(4) + struct.pack(">II2s2sII", 1, 12, b"en", b"US", len(name), 28) + name
    white = b"XYZ " + bytes(4) + s15(0.9642, 1.0, 0.8249)
    tags = {b"desc": text, b"cprt": text, b"wtpt": white} | tags
    table, body, offset = b"", b"", 132 + 12 * len(tags)
    for key, value in tags.items():
        value += bytes(-len(value) % 4)
        table += struct.pack(">4sII", key, offset + len(body), len(value))
        body += value
    head = struct.pack(">I4sI4s4s4s", 0, b"lcms", 0x04200000, b"mntr", space, connection)
    head += struct.pack(">6H", 2026, 1, 1, 0, 0, 0) + b"acsp" + bytes(28) + s15(0.9642, 1.0, 0.8249)
    whole = head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + body
    return struct.pack(">I", len(whole)) + whole[4:]


def of_matrix(colorants: np.ndarray, curve: bytes) -> bytes:
    columns = {
        name: b"XYZ " + bytes(4) + s15(*colorants[:, k]) for k, name in enumerate((b"rXYZ", b"gXYZ", b"bXYZ"))
    }
    return profile(b"RGB ", columns | dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve))


@pytest.mark.parametrize("colorants", [ADOBE, P3, PROPHOTO], ids=["Adobe RGB", "Display P3", "ProPhoto"])
@pytest.mark.parametrize("curve", [GAMMA, OF_SRGB, SAMPLED], ids=["gamma", "parametric", "sampled"])
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_colours_are_those_of_a_colour_management_library(tmp_path, colorants, curve, suffix):
    data, muted = of_matrix(colorants, curve), (CODES // 3 + 90).astype(np.uint8)  # inside the gamut of sRGB
    path = tmp_path / f"a.{suffix}"
    Image.fromarray(muted).save(path, icc_profile=data)
    meant = ImageCms.profileToProfile(
        Image.fromarray(muted), ImageCms.ImageCmsProfile(BytesIO(data)), ImageCms.createProfile("sRGB"),
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )  # fmt: skip
    off = encode_srgb8(read_photo(path)).astype(int) - np.asarray(meant).astype(int)
    assert np.abs(off).max() <= 1
    assert np.abs(np.asarray(meant).astype(int) - muted).max() > 5  # it matters
    assert remarks_on(path, False, True) == []


def test_sixteen_bits_are_converted_as_eight_are_without_their_rounding(tmp_path):
    data = of_matrix(P3, OF_SRGB)
    Image.fromarray(CODES).save(tmp_path / "eight.png", icc_profile=data)
    _, deep = cv2.imencode(".png", (CODES[..., ::-1].astype(np.uint16) * 257))
    with Image.open(tmp_path / "eight.png") as image:
        assert image.info["icc_profile"] == data
    chunk = _chunk_of((tmp_path / "eight.png").read_bytes())
    (tmp_path / "deep.png").write_bytes(deep.tobytes()[:33] + chunk + deep.tobytes()[33:])
    np.testing.assert_allclose(
        read_photo(tmp_path / "deep.png"), read_photo(tmp_path / "eight.png"), atol=1e-5
    )


def _chunk_of(png: bytes) -> bytes:
    """The chunk iCCP, whole."""
    at = png.index(b"iCCP") - 4
    return png[at : at + 12 + struct.unpack_from(">I", png, at)[0]]


def test_colours_beyond_srgb_stay_and_light_is_never_negative(tmp_path):
    Image.fromarray(np.full((4, 4, 3), (0, 255, 0), np.uint8)).save(
        tmp_path / "a.png", icc_profile=of_matrix(PROPHOTO, GAMMA)
    )
    linear = read_photo(tmp_path / "a.png")
    assert linear[..., 1].min() > 1.1 and linear.min() == 0


def test_a_profile_that_means_srgb_changes_no_bit(tmp_path):
    Image.fromarray(CODES).save(tmp_path / "a.png", icc_profile=of_matrix(SRGB_IN_D50 + 1e-4, OF_SRGB))
    np.testing.assert_allclose(read_photo(tmp_path / "a.png"), linear_from_srgb(CODES / 255), atol=2e-5)


def test_grey_takes_its_curve(tmp_path):
    data = profile(b"GRAY", {b"kTRC": GAMMA})
    Image.fromarray(CODES[..., 0]).save(tmp_path / "a.png", icc_profile=data)
    expected = np.repeat((CODES[..., :1] / 255) ** 2.2, 3, axis=2)
    np.testing.assert_allclose(read_photo(tmp_path / "a.png"), expected, atol=2e-3)


@pytest.mark.parametrize(
    "data",
    [
        profile(b"RGB ", {b"A2B0": bytes(32)}),
        profile(b"CMYK", {b"kTRC": GAMMA}),
        profile(b"RGB ", {b"rTRC": GAMMA}),
        profile(b"GRAY", {b"kTRC": b"curv" + bytes(4) + struct.pack(">I", 9)}),
        profile(b"GRAY", {b"kTRC": b"curv" + bytes(4) + struct.pack(">I2H", 2, 65535, 0)}),
        profile(b"GRAY", {b"kTRC": b"what" + bytes(30)}),
        of_matrix(P3, GAMMA)[:200],
        b"no profile at all",
        b"",
    ],
    ids=["tables", "ink", "no colorants", "short curve", "falling", "no curve", "cut off", "text", "none"],
)  # fmt: skip
def test_other_profiles_are_left_to_srgb_and_said(data, tmp_path):
    assert read_profile(data) is None
    if data:
        Image.fromarray(CODES).save(tmp_path / "a.png", icc_profile=data)
        np.testing.assert_allclose(read_photo(tmp_path / "a.png"), linear_from_srgb(CODES / 255), atol=1e-6)
        assert "taken as sRGB" in remarks_on(tmp_path / "a.png", False, True)[0]


@given(st.integers(0, 600), st.binary(min_size=1, max_size=4))
def test_damage_is_no_failure(at, bytes_there):
    whole = of_matrix(ADOBE, SAMPLED)
    damaged = whole[:at] + bytes_there + whole[at + len(bytes_there) :]
    found = read_profile(damaged)
    assert found is None or np.isfinite(found.linear(CODES)).all()
