"""Pairs by position: EXIF data as cameras write them, and worse; the nearest photos find each other."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from pipeline import UserError
from stages.motion.positions import GPS_IFD, Position, near_pairs, position_of, reach_m
from stages.motion.sfm_settings import SfmSettings
from stages.sfm import SFM


def write_photo(path: Path, gps: dict | None, seed: int = 0) -> Path:
    """Noise with a GPS directory."""
    pixels = np.random.default_rng(seed).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    exif = Image.Exif()
    exif[0x0131] = "a test"  # an empty main directory is not written
    if gps is not None:
        exif.get_ifd(GPS_IFD).update(gps)
    Image.fromarray(pixels).save(path, exif=exif)
    return path


def at(latitude: float, longitude: float) -> dict:
    """A GPS directory, in degrees, minutes and seconds."""

    def parts(value: float) -> tuple[IFDRational, ...]:
        degrees, rest = divmod(abs(value), 1)
        minutes, rest = divmod(60 * rest, 1)
        return IFDRational(int(degrees)), IFDRational(int(minutes)), IFDRational(round(6e7 * rest), 10**6)

    return {
        1: "S" if latitude < 0 else "N",
        2: parts(latitude),
        3: "W" if longitude < 0 else "E",
        4: parts(longitude),
    }


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
@pytest.mark.parametrize("place", [(48.2069, 16.3731), (-33.8568, 151.2153), (40.6892, -74.0445)])
def test_a_position_is_read_to_a_decimetre(tmp_path, suffix, place):
    found = position_of(write_photo(tmp_path / f"a{suffix}", at(*place)))
    assert (found.latitude, found.longitude) == pytest.approx(place, abs=1e-6)


BROKEN = {
    "no directory": None,
    "empty": {},
    "one angle": {2: (IFDRational(48), IFDRational(1), IFDRational(1))},
    "over nothing": at(48, 16) | {2: (IFDRational(48), IFDRational(1, 0), IFDRational(0))},
    "beyond the pole": at(48, 16) | {2: (IFDRational(99), IFDRational(0), IFDRational(0))},
    "two parts": at(48, 16) | {4: (IFDRational(16), IFDRational(0))},
    "no satellite": at(0, 0),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_no_position_is_none(tmp_path, name):
    assert position_of(write_photo(tmp_path / "a.jpg", BROKEN[name])) is None


def test_files_that_are_no_photos_have_no_position(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff\xe1" + bytes(40))
    assert position_of(tmp_path / "a.jpg") is None
    assert position_of(tmp_path / "missing.jpg") is None


@given(st.integers(2, 60), st.integers(1, 70), st.integers(0, 5), st.floats(-80, 80), st.floats(-180, 180))
def test_each_photo_is_paired_with_its_nearest(count, neighbours, seed, latitude, longitude):
    """Against all distances on the ground, in metres; across the date line as anywhere."""
    east, north = np.random.default_rng(seed).uniform(-200, 200, (2, count))
    metre = 360 / 40_000_000
    positions = [
        Position(
            latitude + n * metre,
            (longitude + e * metre / np.cos(np.deg2rad(latitude)) + 180) % 360 - 180,
        )
        for e, n in zip(east, north, strict=True)
    ]
    pairs = near_pairs(positions, neighbours)
    assert pairs == sorted(set(pairs)) and all(0 <= i < j < count for i, j in pairs)
    apart = np.hypot(np.subtract.outer(east, east), np.subtract.outer(north, north))
    for photo in range(count):
        paired = [i + j - photo for i, j in pairs if photo in (i, j)]
        others = np.delete(apart[photo], photo)
        assert len(paired) >= min(neighbours, count - 1)
        reach = np.sort(others)[min(neighbours, count - 1) - 1]
        near = {other for other in range(count) if other != photo and apart[photo, other] < reach - 0.01}
        assert near <= set(paired)


def test_photos_at_one_place_are_paired_all_the_same():
    assert near_pairs([Position(1.0, 2.0)] * 4, 3) == [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]


def survey_of(tmp_path, make_job, **settings):
    """Run `sfm` on noise, which is no scene: what was compared is in the record all the same."""
    job = make_job(tmp_path / "job", SFM, SfmSettings(max_features=256, **settings), images=tmp_path)
    with suppress(UserError):
        SFM.run(job)
    return job.facts


def test_many_photos_with_positions_are_compared_by_them_and_else_by_appearance(make_job, tmp_path):
    for number in range(6):
        write_photo(tmp_path / f"{number}.jpg", at(48 + 1e-3 * number, 16), seed=number)
    facts = survey_of(tmp_path, make_job, exhaustive_up_to=5, near=1)
    assert (facts["compared"], facts["pairs_compared"]) == ("positions", 5)
    write_photo(tmp_path / "9.jpg", None, seed=9)
    (tmp_path / "again").mkdir()
    again = tmp_path / "again"
    for photo in tmp_path.glob("*.jpg"):
        photo.rename(again / photo.name)
    assert survey_of(again, make_job, exhaustive_up_to=5)["compared"] == "retrieval"


@pytest.mark.parametrize(("step_deg", "reach"), [(0, 0), (1e-5, 1.11), (1e-3, 111.2)])
def test_positions_within_their_error_do_not_tell_photos_apart(make_job, tmp_path, step_deg, reach):
    """One for a whole museum, or a ring around a statue: each photo would be compared with the same ones."""
    positions = [Position(48 + step_deg * number, 16) for number in range(6)]
    assert reach_m(positions, 1) == pytest.approx(reach, rel=0.01)
    for number, one in enumerate(positions):
        write_photo(tmp_path / f"{number}.jpg", at(one.latitude, one.longitude), seed=number)
    facts = survey_of(tmp_path, make_job, exhaustive_up_to=5, near=1)
    assert facts["compared"] == ("positions" if reach > 15 else "retrieval")


def test_positions_that_are_missing_are_named(make_job, tmp_path):
    for number in range(3):
        write_photo(tmp_path / f"{number}.jpg", at(48, 16) if number else None, seed=number)
    settings = SfmSettings(max_features=256, matching="positions")
    job = make_job(tmp_path / "job", SFM, settings, images=tmp_path)
    with pytest.raises(UserError, match=r"1 of 3 photos have none in their EXIF data: 0\.jpg"):
        SFM.run(job)


@given(
    sizes=st.lists(st.integers(1, 30), min_size=1, max_size=5),
    neighbours=st.integers(1, 8),
    seed=st.integers(0, 9),
)
def test_groups_of_photos_far_apart_are_connected(sizes, neighbours, seed):
    """Many photos from each of some places: what is nearest alone would leave each place to itself."""
    rng = np.random.default_rng(seed)
    photos = [
        Position(48 + 0.01 * place + rng.normal(0, 1e-6), 16 + rng.normal(0, 1e-6))
        for place, size in enumerate(sizes)
        for _ in range(size)
    ]
    pairs = near_pairs(photos, neighbours)
    assert all(i < j for i, j in pairs) and len(set(pairs)) == len(pairs)
    connected = {0}
    while more := {j for pair in pairs for i, j in (pair, pair[::-1]) if i in connected} - connected:
        connected |= more
    assert len(connected) == len(photos)
    assert len(pairs) <= (neighbours + neighbours * (1 + np.log2(len(photos)))) * len(photos)
