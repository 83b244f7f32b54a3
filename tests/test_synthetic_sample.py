"""`sample_data`: its files agree with each other and with the code that made them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stages.formats.colmap.model import cameras_of, read_model
from stages.formats.images.exr import read_exr
from stages.formats.images.photo_folder import find_photos
from stages.formats.images.photos import read_photo
from stages.formats.meshes.triangle_meshes import read_mesh
from stages.geometry.rays import RayCaster
from stages.scene.cameras import Camera, footprint, view_name
from stages.synthetic.sample import halved, rounded, sample_cameras, sample_scene
from stages.synthetic.truth import PaintedSurface

SAMPLE = Path(__file__).parent.parent / "sample_data"


def cameras(folder: str) -> list[Camera]:
    return cameras_of(read_model(SAMPLE / folder))


def test_twelve_photos_twelve_cameras_twelve_albedos():
    photos = find_photos(SAMPLE / "photos")
    assert len(photos) == 12
    names = [view_name(photo) for photo in photos]
    assert names == [camera.name for camera in cameras("truth/sparse")]
    assert sorted(path.stem for path in (SAMPLE / "truth/albedo").glob("*.exr")) == names


def test_the_cameras_are_those_of_the_code():
    for stored, made in zip(cameras("truth/sparse"), sample_cameras(), strict=True):
        assert stored.shape == made.shape
        np.testing.assert_allclose(stored.intrinsics, made.intrinsics)
        np.testing.assert_allclose(stored.cam_from_world, made.cam_from_world, atol=1e-12)


def test_the_true_albedo_lies_on_the_mesh_and_explains_the_photos():
    """Eq. 1: I = ρ S, with a shading that neither vanishes nor grows beyond what sky and lamp can give."""
    seen_by = RayCaster(read_mesh(SAMPLE / "truth/mesh.ply"))
    for camera in cameras("truth/sparse")[::4]:
        albedo = read_exr(SAMPLE / f"truth/albedo/{camera.name}.exr")
        photo = read_photo(SAMPLE / f"photos/{camera.name}.jpg")
        assert albedo.shape == photo.shape == (*camera.shape, 3)
        assert albedo.min() >= 0 and albedo.max() <= 0.9
        inside = albedo.max(axis=-1) > 0
        assert 0.3 < inside.mean() < 0.6
        on_mesh = seen_by.see(camera).mask
        assert (inside & ~on_mesh).sum() < 0.001 * inside.sum()  # the mask is strict: only whole pixels
        shading = np.median(photo[inside] / albedo[inside], axis=0)
        assert (shading > 0.3).all() and (shading < 2).all()
        assert (photo[inside].max(axis=-1) >= 1).mean() < 0.005


def test_the_linear_views_are_the_photos_at_half_size():
    small = cameras("linear/sparse")
    assert len(small) == 4
    for camera in small:
        image = read_exr(SAMPLE / f"linear/images/{camera.name}.exr")
        albedo = read_exr(SAMPLE / f"linear/albedo/{camera.name}.exr")
        assert image.shape == albedo.shape == (*camera.shape, 3)
        unclipped = image.max(axis=-1) < 0.9
        photo = halved(read_photo(SAMPLE / f"photos/{camera.name}.jpg"))
        assert np.sqrt(np.mean((photo - image)[unclipped] ** 2)) < 0.02
        inside = albedo.max(axis=-1) > 0
        large = halved(read_exr(SAMPLE / f"truth/albedo/{camera.name}.exr"))
        np.testing.assert_allclose(albedo[inside], large[inside], rtol=0.01)


def test_the_figures_hold_what_the_issue_asks():
    figures = json.loads((SAMPLE / "truth/figures.json").read_text(encoding="utf-8"))
    assert figures["noise_over_mean"] < 0.02
    assert figures["mesh_deviation_footprints"]["p95"] < 0.2
    light = json.loads((SAMPLE / "truth/light.json").read_text(encoding="utf-8"))
    assert light["exposure"] == figures["exposure"]
    assert sum(path.stat().st_size for path in SAMPLE.rglob("*") if path.is_file()) < 6e6


@pytest.mark.slow
def test_the_code_makes_the_stored_albedo_and_the_mesh_is_its_surface():
    scene = sample_scene()
    surface = PaintedSurface(scene.bust.surface, scene.albedo)
    camera = scene.cameras[3]
    truth = surface.truth(camera)
    stored = read_exr(SAMPLE / f"truth/albedo/{camera.name}.exr")
    assert (np.abs(rounded(truth.albedo) - stored) > 0.005).mean() < 1e-3
    depth = RayCaster(read_mesh(SAMPLE / "truth/mesh.ply")).see(camera).depth
    error = np.abs(depth - truth.depth)[truth.mask] / footprint(camera, truth.depth[truth.mask])
    assert np.median(error) < 0.1
