"""Visibility, interreflections and light search together: grey stays grey in a niche with a red wall.

The photo has a quarter of its brightness in there, and is reddish. Without interreflections (`bounces` 0) the
albedo comes out a sixth too bright inside, and redder than the photo: what is asserted would fail.
"""

from __future__ import annotations

import numpy as np
import pytest

from stages.scene.cameras import pixel_centres
from tests.stored_scene import Decomposed, decomposed

GREY, INSIDE = 0.5, ((-0.41, 0.41), (0.1, 0.87), (-0.03, 0.77))  # x, y, z of the box, walls and ground too
IN_FRONT = -0.1  # y: ground that sees nearly all the sky
QUICKLY = {"lighting": {"samples": 2000}, "transfer": {"light_distances": []}}


@pytest.fixture(scope="module")
def niche(tmp_path_factory: pytest.TempPathFactory) -> Decomposed:
    return decomposed("niche", tmp_path_factory.mktemp("niche"), QUICKLY)


def grey_inside_over_in_front(niche: Decomposed, kind: str) -> np.ndarray:
    """Log of the grey pixels inside over the typical one in front, (n, 3), of all views."""
    inside, in_front = [], []
    for view in niche.names:
        stored, values = niche.stored(view), niche.values(kind, view)
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


def test_the_albedo_in_the_niche_is_neither_dark_nor_red(niche: Decomposed):
    photo, albedo = (grey_inside_over_in_front(niche, kind) for kind in ("image", "albedo"))
    assert len(albedo) > 500
    assert np.exp(np.median(photo.mean(axis=1))) < 0.3, "the niche is no test if it is not dark"
    assert np.median(photo[:, 0] - photo[:, 1]) > 0.08, "nor if it is not reddish"
    assert abs(np.median(albedo.mean(axis=1))) < 0.15
    assert abs(np.median(albedo[:, 0] - albedo[:, 1])) < 0.04


def test_the_whole_niche_is_better_than_its_photo_by_far(niche: Decomposed):
    assert np.all(np.array(niche.scores("albedo").si_rmse) < 0.4 * np.array(niche.scores("image").si_rmse))
