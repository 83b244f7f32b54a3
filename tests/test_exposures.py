"""Exposures by EXIF data: read, compared, and the gains of views that nothing else is known of."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from stages.formats.decoders.exif_copies import copied_exif
from stages.formats.decoders.exif_exposure import exposure_of, range_ev, relative_exposures
from stages.photometry.lighting.settings import ViewGainSettings
from stages.photometry.lighting.view_gains import PairRatio, log_gains, view_gains
from stages.undistort import UndistortSettings
from tests.sphere_scene import sphere_scene
from tests.test_undistort import lens_of, one_image_model, undistort

DETAILS, TIME, APERTURE, ISO = 0x8769, 0x829A, 0x829D, 0x8827


def photo(path: Path, **tags: object) -> Path:
    """A grey JPEG with these EXIF data."""
    exif = Image.Exif()
    numbers = {"time": TIME, "aperture": APERTURE, "iso": ISO}
    exif[DETAILS] = {numbers[name]: value for name, value in tags.items()}
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(np.full((60, 80, 3), 120, np.uint8)).save(path, exif=exif.tobytes())
    return path


@pytest.mark.parametrize("suffix", [".jpg", ".tif", ".png", ".webp"])
def test_an_exposure_is_time_by_sensitivity_over_the_square_of_the_f_number(suffix, tmp_path):
    taken = photo(tmp_path / f"a{suffix}", time=0.01, aperture=8.0, iso=200)
    assert exposure_of(taken) == pytest.approx(0.01 * 200 / 64)


@pytest.mark.parametrize(
    "tags",
    [
        {"time": 0.01, "aperture": 8.0},
        {"time": 0.01, "iso": 200},
        {"time": 0.01, "aperture": 0.0, "iso": 200},
        {"time": 0.0, "aperture": 8.0, "iso": 200},
        {"time": 0.01, "aperture": 8.0, "iso": 0},
        {"time": 0.01, "aperture": "wide", "iso": 200},
    ],
)
def test_an_exposure_that_is_not_all_there_is_none(tags, tmp_path):
    assert exposure_of(photo(tmp_path / "a.jpg", **tags)) is None


def test_a_file_without_exif_data_or_without_a_picture_has_no_exposure(tmp_path):
    Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(tmp_path / "a.jpg")
    (tmp_path / "b.jpg").write_bytes(b"none")
    assert exposure_of(tmp_path / "a.jpg") is None and exposure_of(tmp_path / "b.jpg") is None


@pytest.mark.parametrize("suffix", [".jpg", ".tif", ".png", ".webp"])
def test_exif_data_with_changed_bytes_are_read_and_copied_as_far_as_they_can_be(suffix, tmp_path):
    rng = np.random.default_rng(0)
    whole = photo(tmp_path / f"a{suffix}", time=0.01, aperture=8.0, iso=200).read_bytes()
    begin = whole.find(b"Exif") if b"Exif" in whole else len(whole) - 300
    for _ in range(200):
        data = bytearray(whole)
        for place in rng.integers(begin, min(begin + 200, len(data)), 5):
            data[place] = rng.integers(256)
        changed = tmp_path / f"b{suffix}"
        changed.write_bytes(data)
        exposure = exposure_of(changed)
        assert exposure is None or exposure > 0
        copied_exif(changed, 1, (80, 60)).tobytes()


def test_exposures_are_compared_only_where_all_are_known_and_differ():
    relative = relative_exposures({"a": 1.0, "b": 4.0})
    assert relative == pytest.approx({"a": 0.5, "b": 2.0})
    assert range_ev(relative) == pytest.approx(2)
    assert relative_exposures({"a": 1.0, "b": None}) == {}
    assert relative_exposures({"a": 3.0, "b": 3.0}) == {}
    assert relative_exposures({}) == {}


@given(st.integers(2, 8), st.integers(0, 5))
def test_exposures_do_not_change_what_correspondences_say_but_for_one_factor(views, seed):
    rng = np.random.default_rng(seed)
    true = rng.normal(0, 0.3, (views, 3))
    ratios = [PairRatio(i, i + 1, true[i] - true[i + 1], np.full(3, 80)) for i in range(views - 1)]
    found = log_gains(views, ratios, np.exp(rng.normal(0, 1, views)))
    np.testing.assert_allclose(found - found[0], true - true[0], atol=1e-9)


def test_exposures_decide_between_groups_of_views_that_no_pair_connects():
    """Two and two of a bracketed set, the pairs of which agree with their exposures; and one view alone."""
    exposures = np.array([0.5, 1.0, 2.0, 0.5, 4.0])
    logs = np.log(exposures)
    ratios = [PairRatio(i, j, np.full(3, logs[i] - logs[j]), np.full(3, 80)) for i, j in [(0, 1), (2, 3)]]
    np.testing.assert_allclose(log_gains(5, ratios, exposures), np.repeat(logs[:, None], 3, axis=1))


def test_a_bracketed_set_without_links_has_the_radiance_of_one_that_is_not():
    scene = sphere_scene(view_count=3)
    scene.correspondences = {}
    image = np.concatenate([one[mask] for one, mask in zip(scene.images, scene.masks, strict=True)])
    views, exposures = scene.stacked(), np.array([0.5, 1.0, 2.0])
    of_pixel = np.repeat(exposures, np.diff(views.starts))[:, None]
    everything = np.ones(len(image), bool)
    found = view_gains(views, image * of_pixel, everything, ViewGainSettings(), None, exposures)
    assert np.allclose(image * of_pixel / np.repeat(found.gains, np.diff(views.starts), axis=0), image)


def exposures_in(make_job, folder: Path, out: str, settings=None) -> tuple[dict[str, float], list[str]]:
    """What `undistort` writes and says of three photos in a folder."""
    lens = lens_of("PINHOLE", 80, 60, 70, 70, 40, 30)
    said: list[str] = []
    model = one_image_model("{}.jpg", lens, 3)
    job = undistort(make_job, folder, model, folder / "photos", settings, out=out)
    said += job.warnings
    return json.loads(job.outputs["exposures"].read_text()), said


def test_undistort_writes_the_exposures_of_a_bracketed_set_unless_it_is_told_not_to(make_job, tmp_path):
    for number, time in enumerate([0.01, 0.02, 0.04]):
        photo(tmp_path / f"photos/{number}.jpg", time=time, aperture=8.0, iso=100)
    written, _ = exposures_in(make_job, tmp_path, "used")
    assert written == pytest.approx({"0": 0.5, "1": 1.0, "2": 2.0})
    assert exposures_in(make_job, tmp_path, "not", UndistortSettings(exif_exposure=False))[0] == {}
    photo(tmp_path / "photos/1.jpg", time=0.01)
    assert exposures_in(make_job, tmp_path, "lacking")[0] == {}
