"""Visibility, interreflections and light search together: grey stays grey in a niche with a red wall.

The photo has a quarter of its brightness in there, and is reddish. Without interreflections (`bounces` 0) the
albedo comes out a sixth too bright inside, and redder than the photo: what is asserted would fail.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from benchmarks.accuracy.stored_scene import StoredScene
from stages.scene.cameras import pixel_centres

GREY, INSIDE = 0.5, ((-0.41, 0.41), (0.1, 0.87), (-0.03, 0.77))  # x, y, z of the box, walls and ground too
IN_FRONT = -0.1  # y: ground that sees nearly all the sky
Maps = Mapping[str, np.ndarray]  # by view, (h, w, 3)
QUICKLY = {"lighting": {"samples": 2000}, "transfer": {"light_distances": []}}


@pytest.fixture(scope="module")
def niche(tmp_path_factory: pytest.TempPathFactory) -> StoredScene:
    return StoredScene.unpacked("niche", tmp_path_factory.mktemp("niche"))


@pytest.fixture(scope="module")
def photos(niche: StoredScene) -> Maps:
    return niche.photos()


@pytest.fixture(scope="module")
def albedo(niche: StoredScene) -> Maps:
    return niche.decomposed(QUICKLY)["albedo"]


def grey_inside_over_in_front(niche: StoredScene, maps: Maps) -> np.ndarray:
    """Log of the grey pixels inside over the typical one in front, (n, 3), of all views."""
    inside, in_front = [], []
    for view, values in maps.items():
        stored = niche.of_view(view)
        along_z = stored["depth"][..., None] * directions(stored["intrinsics"], stored["depth"].shape)
        pose = stored["cam_from_world"]
        x = (along_z - pose[:, 3]) @ pose[:, :3]
        grey = stored["mask"] & np.all(np.abs(stored["albedo"] - GREY) < 0.01, axis=2)
        within = [(low < x[..., k]) & (x[..., k] < high) for k, (low, high) in enumerate(INSIDE)]
        inside.append(values[grey & np.all(within, axis=0)])
        in_front.append(values[grey & (x[..., 1] < IN_FRONT)])
    typical = np.median(np.concatenate(in_front), axis=0)
    return np.log(np.maximum(np.concatenate(inside), 1e-4) / typical)


def directions(intrinsics: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Of the rays through the pixels, z = 1, camera axes: (h, w, 3)."""
    pixels = pixel_centres(shape[1], shape[0]).reshape(*shape, 2)
    ahead = (pixels - intrinsics[:2, 2]) / intrinsics[[0, 1], [0, 1]]
    return np.concatenate([ahead, np.ones((*shape, 1))], axis=2)


def test_the_albedo_in_the_niche_is_neither_dark_nor_red(niche: StoredScene, photos: Maps, albedo: Maps):
    shown, found = (grey_inside_over_in_front(niche, maps) for maps in (photos, albedo))
    assert len(found) > 500
    assert np.exp(np.median(shown.mean(axis=1))) < 0.3, "the niche is no test if it is not dark"
    assert np.median(shown[:, 0] - shown[:, 1]) > 0.08, "nor if it is not reddish"
    assert abs(np.median(found.mean(axis=1))) < 0.15
    assert abs(np.median(found[:, 0] - found[:, 1])) < 0.04


def test_the_whole_niche_is_better_than_its_photo_by_far(niche: StoredScene, photos: Maps, albedo: Maps):
    of_photos, of_albedo = (np.array(niche.scores(maps).si_rmse) for maps in (photos, albedo))
    assert np.all(of_albedo < 0.4 * of_photos)
