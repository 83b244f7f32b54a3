"""The scale laboratory: its truth is consistent, its light is the sky's, and it measures what grows."""

import numpy as np
import pytest

from benchmarks.scale.__main__ import main
from benchmarks.scale.albedo_error import SHARED, albedo_error
from benchmarks.scale.daylight import SKY, Daylight, sun_directions
from benchmarks.scale.photo_set import PhotoSet
from benchmarks.scale.shading_error import by_brightness, errors_of
from benchmarks.scale.street import build_street
from benchmarks.solver.growth import slope
from stages.formats.images.exr import write_exr
from stages.formats.images.photos import write_png_srgb8
from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.occluders import Occluders
from stages.geometry.rays import RayCaster
from stages.scene.cameras import back_project, project

UP = np.array([0, 0, 1], np.float32)


@pytest.fixture(scope="module")
def street():
    return build_street(4, 96, 60)


def test_views_of_a_point_have_one_albedo(street):
    caster = RayCaster(street.surface)
    one, other = (caster.see(camera) for camera in street.cameras[1:3])
    points = back_project(street.cameras[1], one.depth)[one.mask]
    xy, depth = project(street.cameras[2], points)
    column, row = np.floor(xy).astype(int).T
    inside = (column >= 0) & (column < 96) & (row >= 0) & (row < 60) & (depth > 0)
    there = back_project(street.cameras[2], other.depth)[row[inside], column[inside]]
    near = np.linalg.norm(there - points[inside], axis=1) < 0.02
    assert near.mean() > 0.6
    own, others = street.albedo(points[inside][near]), street.albedo(there[near])
    between = np.abs(np.diff(street.albedo(points)[:, 0])).mean()  # of pixels side by side
    assert np.abs(own - others).mean() < between
    assert own.min() >= 0.02 and own.max() <= 0.9


def test_every_view_is_full_of_wall_however_long_the_street(street):
    for camera in (street.cameras[0], street.cameras[-1]):
        assert RayCaster(street.surface).see(camera).mask.mean() > 0.85


def plate(height, half):
    """A horizontal square, seen from both sides."""
    corners = np.array(
        [[-half, -half, height], [half, -half, height], [half, half, height], [-half, half, height]]
    )
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def test_open_ground_has_all_of_sun_and_sky_and_a_roof_takes_them():
    points, normals = np.zeros((1, 3), np.float32), UP[None]
    for covered in (False, True):
        vertices, faces = plate(-1.0, 0.01)
        if covered:
            roof, more = plate(0.5, 300.0)
            vertices, faces = np.concatenate([vertices, roof]), np.concatenate([faces, more + 4])
        occluders = Occluders(Surface(vertices, faces.astype(np.int32)))
        relative = (points - occluders.origin).astype(np.float32)
        lit = Daylight.of(occluders, relative, normals, np.zeros((len(vertices), 3), np.float32)[:1])
        sun = lit.sunlight(relative, normals)[0]
        if covered:
            assert np.all(sun == 0) and np.all(lit.skylight < 0.02)
            continue
        cosine = float(sun_directions().mean(axis=0)[2])
        assert sun == pytest.approx(np.array(SKY.sun) * cosine, rel=1e-3)
        darkest, brightest = np.array(SKY.horizon), np.array(SKY.zenith)
        low, high = np.minimum(darkest, brightest), np.maximum(darkest, brightest)
        assert np.all(lit.skylight[0] > low) and np.all(lit.skylight[0] < high * (1 + SKY.glow))


def test_slopes_of_powers_are_their_exponents():
    views = [10, 30, 100]
    for exponent in (0.0, 1.0, 2.0):
        assert slope(views, [3.0 * n**exponent for n in views]) == pytest.approx(exponent, abs=1e-9)


def test_errors_are_told_over_the_albedo_and_of_the_views_that_all_streets_have(tmp_path):
    rng = np.random.default_rng(0)
    truths = [0.2 * rng.uniform(0.5, 1, (6, 8, 3)) * (1 if n < SHARED else 3) for n in range(SHARED + 4)]
    (tmp_path / "truth").mkdir()
    for number, truth in enumerate(truths):
        np.save(tmp_path / "truth" / f"{number:04d}.npy", truth.astype(np.float16))
        truth = truth.astype(np.float16).astype(np.float32)
        off = 0.1 * np.where(np.arange(6) % 2, 1, -1)[:, None, None]  # of the albedo, rows in turn
        write_exr(tmp_path / "albedo" / f"{number:04d}.exr", (2 * truth * (1 + off)).astype(np.float32))
    error = albedo_error(PhotoSet(tmp_path, len(truths)), tmp_path / "albedo")
    assert error.relative == pytest.approx([0.1] * 3, rel=0.03)
    first = np.sqrt(np.mean(np.square(truths[:SHARED])))
    assert error.shared == pytest.approx([0.1 * first] * 3, rel=0.05)
    assert error.si_rmse == pytest.approx([0.1 * np.sqrt(np.mean(np.square(truths)))] * 3, rel=0.05)


@pytest.mark.slow
def test_two_lengths_are_measured_as_far_as_the_albedo(tmp_path):
    measured = main(["--views", "3,5", "--size", "64x40", "--workspace", str(tmp_path)])
    assert [one.views for one in measured] == [3, 5]
    for one in measured:
        assert {"correspondence", "lighting", "decomposition"} <= one.stages.keys()
        assert all(taken.peak_bytes > 0 for taken in one.stages.values())
        assert one.error is not None and max(one.error.si_rmse) < 0.2
    assert "slope" in (tmp_path / "scale.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_run_that_ends_before_the_albedo_has_no_error(tmp_path):
    options = ["--views", "3", "--size", "64x40", "--workspace", str(tmp_path), "--", "--to", "raycast"]
    (measured,) = main(options)
    assert "raycast" in measured.stages and measured.error is None
    assert "Error" not in (tmp_path / "scale.md").read_text(encoding="utf-8")


def test_a_shading_that_is_too_bright_in_the_dark_is_said_to_be(tmp_path):
    """In any unit: twice as bright everywhere, and by a tenth more in the dark half."""
    photos, rng = PhotoSet(tmp_path, 1), np.random.default_rng(0)
    albedo = rng.uniform(0.2, 0.8, (60, 80, 3)).astype(np.float16)
    shading = np.where(np.arange(80) < 40, 0.2, 0.8)[None, :, None] * np.ones((60, 1, 3))
    (tmp_path / "truth").mkdir()
    np.save(tmp_path / "truth" / "0000.npy", albedo)
    write_png_srgb8(photos.photos / "0000.png", albedo * shading)
    found = 2 * shading * np.where(shading < 0.5, 1.1, 1)
    write_exr(tmp_path / "shading" / "0000.exr", found.astype(np.float32))
    parts = by_brightness(*errors_of(photos, tmp_path / "shading"))
    dark, bright = parts[0].mean, parts[-1].mean
    assert np.allclose(dark - bright, np.log(1.1), atol=0.01)
