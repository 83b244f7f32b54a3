"""The courtyard without an arcade: what is withheld, and how much of its shadow an albedo has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.scale.photo_set import PhotoSet
from benchmarks.withheld import Courtyard, build, contrast_left, main, render
from stages.formats.images.exr import write_exr
from stages.formats.images.photos import read_mask, read_photo
from stages.formats.meshes.triangle_meshes import read_mesh


@pytest.fixture(scope="module")
def yard() -> Courtyard:
    return build(2, 96, 72, spacing=0.02)


@pytest.fixture(scope="module")
def photos(yard: Courtyard, tmp_path_factory: pytest.TempPathFactory) -> PhotoSet:
    made = PhotoSet(tmp_path_factory.mktemp("withheld"), 2)
    render(made, yard)
    return made


def test_the_given_mesh_lacks_one_arcade_and_the_masks_show_the_rest(yard: Courtyard, photos: PhotoSet):
    mesh = read_mesh(photos.mesh)
    high = mesh.vertices[mesh.vertices[:, 2] > 0.3]
    assert high[:, 0].max() > 0.5 and (high[high[:, 0] < -0.4][:, 1] > 0.3).all()  # the back wall alone
    assert 0.7 < len(mesh.faces) / len(yard.surface.faces) < 0.95
    for camera in yard.cameras:
        mask = read_mask(photos.folder / "masks" / f"{camera.name}.png")
        np.testing.assert_array_equal(mask, (photos.true_albedo(camera.name) > 0).all(axis=2))
        assert 0.1 < mask.mean() < 0.6


def test_the_photos_have_the_whole_contrast_of_the_withheld_shadow_and_the_truth_has_none(
    yard: Courtyard, photos: PhotoSet, tmp_path: Path
):
    for share in (0.0, 0.3):
        for camera in yard.cameras:
            stored = np.load(photos.folder / "withheld" / f"{camera.name}.npy", allow_pickle=False)
            hidden = stored.astype(np.float32)
            assert hidden.min() >= 0 and 0.01 < (hidden.mean(axis=2) > 0.3).mean() < 0.2
            albedo = photos.true_albedo(camera.name).astype(np.float32) * np.exp(-share * hidden)
            write_exr(tmp_path / f"{camera.name}.exr", albedo)
        assert contrast_left(photos, tmp_path) == pytest.approx(share, abs=0.01)
    for camera in yard.cameras:
        photo = read_photo(photos.photos / f"{camera.name}.png")
        write_exr(tmp_path / f"{camera.name}.exr", photo.astype(np.float32))
    assert contrast_left(photos, tmp_path) == pytest.approx(1, abs=0.3)


@pytest.mark.slow
def test_the_shadow_of_the_withheld_arcade_is_taken_out_of_the_albedo(tmp_path: Path):
    main(
        [
            "--views",
            "5",
            "--size",
            "240x180",
            "--workspace",
            str(tmp_path),
            "--picture",
            str(tmp_path / "a.png"),
        ]
    )
    photos = PhotoSet(tmp_path, 5)
    left = {
        name: contrast_left(photos, tmp_path / name / "output" / "albedo") for name in ("without", "with")
    }
    assert left["without"] > 0.8 and left["with"] < 0.3
    assert read_photo(tmp_path / "a.png").shape[1] > 1000
