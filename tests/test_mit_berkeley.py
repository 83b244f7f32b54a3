"""Normals of orthographic height maps against known ones; one real object where the data is there."""

import cv2
import numpy as np
import pytest

from benchmarks.mit_berkeley.methods import Problem, by_transfer, images_themselves
from benchmarks.mit_berkeley.objects import (
    FOLDER,
    LAMPS,
    LampObject,
    normals_from_height,
    objects_folder,
    read_object,
)
from benchmarks.mit_berkeley.sources import write_sources
from pipeline import UserError
from pipeline.command.terminal import Terminal
from stages.formats.colmap.model import cameras_of, read_model
from stages.formats.images.photo_folder import find_photos
from stages.formats.images.photos import read_photo
from stages.formats.meshes.triangle_meshes import read_mesh
from stages.geometry.rays import RayCaster


def test_a_plane_has_its_one_normal_up_to_its_rim_and_around_holes():
    """h = 0.75 x − 0.5 y: nearer to the right and to the top, so that it faces left, down, and the viewer."""
    y, x = np.mgrid[:9, :7].astype(float)
    valid = np.ones((9, 7), bool)
    valid[0, :3] = valid[4, 3] = valid[8, 6] = False
    height = np.where(valid, 0.75 * x - 0.5 * y, 1e6)
    normals = normals_from_height(height, valid)
    expected = np.array([-0.75, 0.5, -1]) / np.linalg.norm([0.75, 0.5, 1])
    assert np.allclose(normals[valid], expected)
    assert not normals[~valid].any()


def test_a_sphere_faces_away_from_its_centre():
    y, x = np.mgrid[-60:61, -60:61].astype(float)
    radius = 55.0
    valid = x**2 + y**2 < (0.8 * radius) ** 2
    height = np.sqrt(np.where(valid, radius**2 - x**2 - y**2, 1))
    expected = np.stack([x, y, -height], axis=-1) / radius  # towards the viewer: against z forward
    cosine = (normals_from_height(height, valid) * expected).sum(axis=-1)[valid]
    inside = x**2 + y**2 < (0.75 * radius) ** 2  # at the rim differences are one-sided
    assert np.degrees(np.arccos(np.minimum(cosine, 1))).max() < 2.5
    assert np.degrees(np.arccos(np.minimum(cosine[inside[valid]], 1))).max() < 0.1


def test_a_pixel_without_neighbours_faces_the_viewer():
    valid = np.zeros((3, 3), bool)
    valid[1, 1] = True
    assert normals_from_height(np.full((3, 3), 7.0), valid)[1, 1].tolist() == [0, 0, -1]


def bowl() -> LampObject:
    """A bowl with a hole in it, striped across its slopes, under ten far lamps."""
    y, x = np.mgrid[-12:13, -15:16].astype(float)
    mask = (x**2 + y**2 < 120) & (np.hypot(x - 4, y) > 3)
    height = np.where(mask, (x**2 + 2 * y**2) / 60 + 0.2 * x, 0)
    normals = normals_from_height(height, mask)
    reflectance = np.where(mask, np.where((x + y) % 12 < 6, 0.9, 0.4), 0).astype(np.float32)
    angles = np.arange(LAMPS) * 2 * np.pi / LAMPS
    towards = np.stack([0.6 * np.cos(angles), 0.6 * np.sin(angles), np.full(LAMPS, -0.8)], axis=1)
    lit = np.maximum(np.einsum("hwc,lc->lhw", normals, towards), 0) * reflectance
    photos = (lit[..., None] * [1, 0.8, 0.6]).astype(np.float32)
    return LampObject("bowl", mask, photos, reflectance, normals, height)


def test_an_object_is_brought_as_cameras_and_a_mesh_that_show_it_as_it_is(tmp_path):
    """Every pixel of the mask is hit, no other, at its height, with its normal."""
    subject = bowl()
    sources = write_sources(subject, tmp_path)
    assert len(find_photos(sources["images"])) == LAMPS
    assert np.array_equal(read_photo(sources["images"] / "lamp03.exr"), subject.photos[2])
    cameras = cameras_of(read_model(sources["colmap"]))
    assert [camera.name for camera in cameras] == [f"lamp{k:02d}" for k in range(1, LAMPS + 1)]
    seen = RayCaster(read_mesh(sources["mesh_file"])).see(cameras[-1])
    assert np.array_equal(seen.mask, subject.mask)
    inside = cv2.erode(subject.mask.astype(np.uint8), np.ones((3, 3))) > 0
    off = (seen.depth + subject.height)[inside]
    assert np.ptp(off) < 0.01  # pixels
    cosine = (seen.normals * subject.normals).sum(axis=-1)[subject.mask]
    assert np.median(cosine) > np.cos(np.radians(2))
    assert cosine.min() > np.cos(np.radians(25))  # at the rim


def test_the_program_itself_takes_the_lamps_light_off(tmp_path):
    problem = Problem.of(bowl())
    ours = by_transfer(problem, tmp_path, 1, Terminal())
    photos = next(row for row in images_themselves(problem) if row.method == "the photos, all ten")
    assert ours.si_rmse < 0.5 * photos.si_rmse


def test_without_data_the_folder_to_fill_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("UNSHADE_DATA", str(tmp_path))
    with pytest.raises(UserError, match="MIT-Berkeley-Laboratory"):
        objects_folder()
    monkeypatch.delenv("UNSHADE_DATA")
    with pytest.raises(UserError, match="UNSHADE_DATA is not set"):
        objects_folder()


def test_the_box_under_ten_lamps(data_folder):
    """Eq. 2 whole on a real object, small: ten albedos nearer to the measured one than the photos are."""
    if not (data_folder / FOLDER).is_dir():
        pytest.skip("the MIT-Berkeley objects are not there")
    subject = read_object(data_folder / FOLDER / "box", 8)
    assert subject.lamps.shape == (LAMPS, *subject.mask.shape)
    assert np.allclose(np.linalg.norm(subject.normals[subject.mask], axis=-1), 1)
    assert (subject.normals[subject.mask][:, 2] < 0).all()
    problem = Problem.of(subject)
    photos = next(row for row in images_themselves(problem) if row.method == "the photos, all ten")
    paper = problem.score_descent("mode: paper", problem.decompose(2, 1, limit=10), 2, 1)
    assert paper.si_rmse < photos.si_rmse
