"""Pairs by appearance: photos of one place find each other among others, on any number of threads."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pycolmap
import pytest

from pipeline import UserError
from stages.formats.images.photos import write_png_srgb8
from stages.motion.database import copy_name, write_features
from stages.motion.features import detect, read_features
from stages.motion.retrieval import similar_pairs
from stages.motion.sfm_settings import RetrievalSettings, SfmSettings
from stages.sfm import SFM
from tests import painted_corner

CORNERS, EACH = 3, 4


@pytest.fixture(scope="module")
def photos(tmp_path_factory) -> Path:
    """Photos of three painted corners, in turns."""
    folder = tmp_path_factory.mktemp("corners")
    for corner in range(CORNERS):
        sheets = painted_corner.paint(corner)
        for view, camera in enumerate(painted_corner.cameras(EACH)):
            place = folder / copy_name(CORNERS * view + corner)
            write_png_srgb8(place, painted_corner.render(camera, sheets, 0.0))
    return folder


@pytest.fixture(scope="module")
def database(photos, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("database")
    copies = sorted(photos.iterdir())
    detect(copies, folder / "found.db", 600, 2)
    camera = pycolmap.Camera.create_from_model_id(1, pycolmap.CameraModelId.SIMPLE_PINHOLE, 300.0, 320, 240)
    with pycolmap.Database.open(folder / "found.db") as found:
        features = (read_features(found, copy, 320, 240) for copy in copies)
        write_features(folder / "database.db", [camera], [0] * len(copies), features)
    return folder / "database.db"


def test_photos_of_one_place_find_each_other(database, tmp_path):
    pairs = similar_pairs(database, RetrievalSettings(neighbours=EACH - 1), tmp_path, threads=2, seed=0)
    of_one_corner = [(i, j) for i, j in pairs if i % CORNERS == j % CORNERS]
    assert len(of_one_corner) == CORNERS * EACH * (EACH - 1) // 2
    assert len(pairs) <= 1.5 * len(of_one_corner)
    assert pairs == sorted(set(pairs)) and all(i < j for i, j in pairs)


def test_threads_change_nothing(database, tmp_path):
    how = RetrievalSettings(neighbours=2)
    assert similar_pairs(database, how, tmp_path, 1, 0) == similar_pairs(database, how, tmp_path, 2, 0)


def test_more_photos_than_are_compared_in_pairs_are_compared_by_appearance(photos, make_job, tmp_path):
    settings = SfmSettings(max_features=600, exhaustive_up_to=11, retrieval=RetrievalSettings(neighbours=3))
    job = make_job(tmp_path, SFM, settings, images=photos)
    with suppress(
        UserError
    ):  # three corners are no one model; what was compared is in the record all the same
        SFM.run(job)
    assert job.facts["compared"] == "retrieval"
    assert job.facts["pairs_compared"] < 12 * 11 // 2
