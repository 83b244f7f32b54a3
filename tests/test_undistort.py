"""Pinhole images: the same light on the same rays, in COLMAP's layout; what needs nothing is left alone."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pycolmap
import pytest

from pipeline import UserError
from stages.formats.colmap.model import cameras_of, read_model, registered
from stages.formats.images.exr import read_exr, says_white, write_exr
from stages.formats.images.photos import encode_srgb8, read_mask, read_photo, write_mask, write_png_srgb8
from stages.geometry.undistortion import oversampling, resample
from stages.geometry.working_size import AutoSizeSettings, affordable_size, expected_minutes, working_size
from stages.scene.cameras import pixel_centres
from stages.undistort import UNDISTORT, UndistortSettings, within
from tests import painted_corner
from tests.raw_exr import write_raw_exr
from tests.test_colmap_model import distorted_model


def one_image_model(name: str, lens: pycolmap.Camera, count: int = 1) -> pycolmap.Reconstruction:
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(lens)
    for index in range(count):
        image = pycolmap.Image(name=name.format(index), camera_id=lens.camera_id, image_id=index + 1)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d())
    return model


def lens_of(model: str, width: int, height: int, *params: float) -> pycolmap.Camera:
    return pycolmap.Camera(camera_id=1, model=model, width=width, height=height, params=list(params))


def undistort(make_job, tmp_path, model, images, settings=None, threads=2, out="out", **inputs):
    (tmp_path / out / "given").mkdir(parents=True)
    model.write(tmp_path / out / "given")
    job = make_job(
        tmp_path / out, UNDISTORT, settings, threads, images=images, model=tmp_path / out / "given", **inputs
    )
    UNDISTORT.run(job)
    return job


@pytest.mark.parametrize(
    ("size", "limit", "expected"),
    [
        ((3072, 2048), 768, (768, 512)),
        ((2048, 3072), 768, (512, 768)),
        ((481, 361), 240, (240, 180)),
        ((100, 80), 768, (100, 80)),
        ((3072, 2048), None, (3072, 2048)),
        ((5000, 2), 100, (100, 1)),
    ],
)
def test_working_size_keeps_the_aspect_and_never_enlarges(size, limit, expected):
    assert working_size(*size, limit) == expected


@pytest.mark.parametrize("photos", [1, 2, 8, 11, 25, 100, 1000])
@pytest.mark.parametrize("size", [(640, 480), (3072, 2048), (2000, 3000), (8192, 5464)])
def test_the_automatic_size_is_the_largest_of_its_steps_that_time_and_memory_allow(photos, size):
    how = AutoSizeSettings()
    wanted = affordable_size(photos * [size], how)
    assert min(how.least_px, *size) <= wanted <= max(size) or wanted == max(size) <= how.least_px

    def allowed(longest):
        width, height = working_size(*size, longest)
        return (
            width * height <= 1e6 * how.view_megapixels
            and expected_minutes(photos * [(width, height)], how) <= how.processor_minutes
        )

    assert allowed(wanted) or wanted == min(how.least_px, max(size))
    assert wanted == max(size) or not allowed(round(wanted * 2**0.25) + 2)


def test_a_photo_more_seldom_changes_the_automatic_size_and_more_time_never_lowers_it():
    sizes = [affordable_size(count * [(3072, 2048)], AutoSizeSettings()) for count in range(8, 60)]
    assert len(set(sizes)) <= 8 and sizes == sorted(sizes, reverse=True)
    by_time = [
        affordable_size(20 * [(3072, 2048)], AutoSizeSettings(processor_minutes=minutes, view_megapixels=100))
        for minutes in (1, 10, 30, 60, 200, 1e6)
    ]
    assert by_time == sorted(by_time) and by_time[0] == 768 and by_time[-1] == 3072


def test_little_memory_lowers_the_automatic_size_and_no_other():
    auto, fixed = UndistortSettings(), UndistortSettings(max_size_px=3000)
    assert within(fixed, 10**9) == fixed and within(auto, 64 * 10**9) == auto
    sizes = [
        affordable_size([(4000, 3000)], within(auto, gigabytes * 10**9).auto) for gigabytes in (1, 2, 4, 64)
    ]
    assert sizes == sorted(sizes) and sizes[0] < sizes[-1]
    width, height = working_size(4000, 3000, sizes[1])
    assert 3 * 480 * width * height <= 2e9


def test_an_automatic_size_is_told_with_what_it_will_take(tmp_path, make_job):
    lens = lens_of("PINHOLE", 1200, 800, 1200, 1200, 600, 400)
    images = tmp_path / "images"
    images.mkdir()
    for index in range(2):
        write_png_srgb8(images / f"{index}.png", np.full((800, 1200, 3), 0.5, np.float32))
    model = one_image_model("{}.png", lens, 2)
    settings = UndistortSettings(auto=AutoSizeSettings(processor_minutes=1.62))
    said: list[str] = []

    def listening(*args, **inputs):
        return replace(make_job(*args, **inputs), say=said.append)

    job = undistort(listening, tmp_path, model, images, settings)
    written = cameras_of(read_model(job.outputs["workspace"] / "sparse"))
    assert {(camera.width, camera.height) for camera in written} == {(849, 566)}
    assert any("Works at 849 px of 1200, about 2 minutes" in sentence for sentence in said)
    said.clear()
    whole = undistort(listening, tmp_path, model, images, None, out="whole")
    written = cameras_of(read_model(whole.outputs["workspace"] / "sparse"))
    assert {(camera.width, camera.height) for camera in written} == {(1200, 800)}
    assert not said


def test_as_many_samples_as_source_pixels():
    assert [oversampling(f, 100.0) for f in (50.0, 100.0, 100.00000001, 101.0, 400.0)] == [1, 1, 1, 2, 4]


def test_reduction_by_four_is_the_mean_of_sixteen_pixels_in_linear_light():
    """Hand-computed law: a checkerboard of 0 and 1 becomes 0.5 linear (code 188), not 0.5 sRGB (code 128)."""
    checkers = np.indices((40, 64)).sum(axis=0) % 2
    linear = np.repeat(checkers[..., None], 3, axis=2).astype(np.float32)
    out, kept = resample(linear, np.ones((40, 64), bool), (16, 10), lambda xy: xy * 4, 4)
    np.testing.assert_allclose(out, 0.5, atol=1e-6)
    assert kept.all() and set(np.unique(encode_srgb8(out))) == {188}


def test_a_ramp_is_reproduced_exactly_where_it_is_seen():
    """Bilinear interpolation and means leave linear functions alone: value x becomes the mean source x."""
    ramp = np.repeat(np.broadcast_to(np.arange(50) + 0.5, (30, 50))[..., None], 3, axis=2).astype(np.float32)
    out, _ = resample(ramp, np.ones((30, 50), bool), (20, 13), lambda xy: xy * 2 + 3, 2)
    expected = pixel_centres(20, 13)[..., 0] * 2 + 3
    np.testing.assert_allclose(out[..., 0], expected, atol=0.05)  # OpenCV rounds coordinates to 1/32


def test_a_pixel_is_kept_only_if_all_its_samples_are_inside_and_kept():
    kept = np.ones((20, 20), bool)
    kept[:, 7] = False
    _, out = resample(np.ones((20, 20, 3), np.float32), kept, (12, 10), lambda xy: xy * 2 - [2, 0], 2)
    expected = np.ones((10, 12), bool)
    expected[:, 0] = False  # source x in [-2, 0]
    expected[:, 4] = False  # source x in [6, 8], with column 7
    expected[:, 11] = False  # source x in [20, 22]
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize(("scale", "samples"), [(1.0, 1), (1.7, 2)])
@pytest.mark.parametrize("shift", [0.1, 0.3, 0.8])
def test_what_is_masked_out_does_not_shine_into_what_is_kept(scale, samples, shift):
    """White beside a masked black half: what is kept is white, and no more is lost than what touches it."""
    kept = np.ones((40, 60), bool)
    kept[:, 27:] = False
    linear = np.repeat(kept[..., None], 3, axis=2).astype(np.float32)
    out, out_kept = resample(linear, kept, (30, 20), lambda xy: xy * scale + [shift, 0], samples)
    assert (out[out_kept] > 0.999).all()
    last = pixel_centres(30, 20)[..., 0] * scale + shift + (samples - 1) / (2 * samples) * scale
    np.testing.assert_array_equal(out_kept, last < 26.5)


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_samples_at_pixel_centres_know_no_neighbours(factor):
    """No lens, a reduction by a whole factor: each pixel is kept where all of its source pixels are."""
    kept = np.random.default_rng(1).random((36, 48)) > 0.2
    size = 48 // factor, 36 // factor
    _, out = resample(np.ones((36, 48, 3), np.float32), kept, size, lambda xy: xy * factor, factor)
    blocks = kept.reshape(size[1], factor, size[0], factor)
    np.testing.assert_array_equal(out, blocks.all(axis=(1, 3)))


def test_pinhole_photos_at_or_below_working_size_pass_to_the_bit(make_job, tmp_path):
    light = np.random.default_rng(0).random((61, 83, 3)).astype(np.float32) * 7
    write_exr(tmp_path / "images" / "a.exr", light)
    model = one_image_model("a.exr", lens_of("PINHOLE", 83, 61, 70.5, 71.0, 40.0, 31.5))
    job = undistort(make_job, tmp_path, model, tmp_path / "images")
    np.testing.assert_array_equal(read_exr(job.outputs["linear"] / "a.exr"), light)
    np.testing.assert_array_equal(
        encode_srgb8(read_photo(job.outputs["workspace"] / "images/a.png")), encode_srgb8(light)
    )
    camera = cameras_of(read_model(job.outputs["workspace"] / "sparse"))[0]
    assert camera.intrinsics.tolist() == [[70.5, 0, 40], [0, 71, 31.5], [0, 0, 1]]
    assert job.facts["resampled"] == 0 and not list(job.outputs["kept"].iterdir())


def test_the_distorted_photo_becomes_the_photo_a_pinhole_camera_takes(make_job, tmp_path):
    """Through a barrel lens and back: the painted corner rendered without a lens, to part of a grey level."""
    camera = painted_corner.cameras(3)[1]
    sheets = np.stack([cv2.GaussianBlur(sheet, (0, 0), 12) for sheet in painted_corner.paint(1)])
    write_exr(tmp_path / "images" / "v.exr", painted_corner.render(camera, sheets, radial=-0.08))
    model = one_image_model("v.exr", lens_of("SIMPLE_RADIAL", 320, 240, 300, 160, 120, -0.08))
    model.images[1].frame.rig_from_world = pycolmap.Rigid3d(camera.cam_from_world)
    job = undistort(make_job, tmp_path, model, tmp_path / "images", UndistortSettings(max_size_px=None))
    pinhole = cameras_of(read_model(job.outputs["workspace"] / "sparse"))[0]
    got = read_exr(job.outputs["linear"] / "v.exr")
    assert got.shape == (pinhole.height, pinhole.width, 3)
    expected = painted_corner.render(
        painted_corner.Camera("v", pinhole.width, pinhole.height, pinhole.intrinsics, pinhole.cam_from_world),
        sheets,
    )
    assert np.abs(got - expected).mean() < 5e-4
    shifted = np.abs(got[:, 1:] - expected[:, :-1]).mean()
    assert shifted > 5 * np.abs(got - expected).mean()  # half a pixel would show


def test_the_workspace_is_laid_out_as_colmap_lays_it_out(make_job, tmp_path):
    """Same tree and same text files as `pycolmap.undistort_images`, which COLMAP itself opens."""
    names = ["sub/photo 0.png", "sub/photo 1.png", "ü.png"]
    for name in names:
        write_png_srgb8(tmp_path / "images" / name, np.full((90, 120, 3), 0.4, np.float32))
    model = distorted_model(3, names)
    job = undistort(make_job, tmp_path, model, tmp_path / "images")
    level, pycolmap.logging.minloglevel = pycolmap.logging.minloglevel, 3
    pycolmap.undistort_images(tmp_path / "colmap", tmp_path / "out" / "given", tmp_path / "images")
    pycolmap.logging.minloglevel = level

    def tree(folder):
        return {
            path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.name.endswith(".sh")
        }

    ours, theirs = job.outputs["workspace"], tmp_path / "colmap"
    assert tree(ours) == tree(theirs)
    for file in ("stereo/fusion.cfg", "stereo/patch-match.cfg"):
        assert sorted((ours / file).read_text().split("\n")) == sorted(
            (theirs / file).read_text().split("\n")
        )
    a, b = read_model(ours / "sparse"), read_model(theirs / "sparse")
    assert [c.name for c in cameras_of(a)] == [c.name for c in cameras_of(b)]
    for mine, its in zip(cameras_of(a), cameras_of(b), strict=True):
        np.testing.assert_allclose(mine.intrinsics, its.intrinsics, atol=1e-9)
        np.testing.assert_allclose(mine.cam_from_world, its.cam_from_world, atol=1e-12)
    assert a.num_points3D() == b.num_points3D() == 40
    for mine, its in zip(registered(a), registered(b), strict=True):
        np.testing.assert_allclose(mine.points2D[5].xy, its.points2D[5].xy, atol=1e-6)
    a.update_point_3d_errors()
    assert a.compute_mean_reprojection_error() < 1e-6


def test_mixed_sizes_keep_their_aspect(make_job, tmp_path):
    model = pycolmap.Reconstruction()
    for index, (width, height) in enumerate([(200, 100), (90, 180), (50, 40)]):
        lens = lens_of("SIMPLE_PINHOLE", width, height, 150, width / 2, height / 2)
        lens.camera_id = index + 1
        model.add_camera_with_trivial_rig(lens)
        image = pycolmap.Image(name=f"{index}.png", camera_id=index + 1, image_id=index + 1)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d())
        write_png_srgb8(tmp_path / "images" / f"{index}.png", np.full((height, width, 3), 0.2))
    job = undistort(make_job, tmp_path, model, tmp_path / "images", UndistortSettings(max_size_px=60))
    cameras = cameras_of(read_model(job.outputs["workspace"] / "sparse"))
    assert [(c.width, c.height) for c in cameras] == [(60, 30), (30, 60), (50, 40)]
    assert [c.intrinsics[0, 0] for c in cameras] == [45, 50, 150]
    assert [read_exr(job.outputs["linear"] / f"{i}.exr").shape[:2] for i in range(3)] == [
        (30, 60),
        (60, 30),
        (40, 50),
    ]


@pytest.mark.parametrize("mask_name", ["1.png", "1.jpg.png"])
def test_masks_follow_the_pixels_and_missing_ones_are_named(make_job, tmp_path, mask_name):
    lens = lens_of("SIMPLE_PINHOLE", 80, 60, 70, 40, 30)
    for index in range(3):
        write_png_srgb8(tmp_path / "images" / f"{index}.png", np.full((60, 80, 3), 0.2))
        (tmp_path / "images" / f"{index}.png").rename(tmp_path / "images" / f"{index}.jpg")
    kept = np.zeros((60, 80), bool)
    kept[:, :42] = True
    write_mask(tmp_path / "masks" / mask_name, kept)
    model = one_image_model("{}.jpg", lens, 3)
    settings = UndistortSettings(max_size_px=40)
    job = undistort(make_job, tmp_path, model, tmp_path / "images", settings, masks=tmp_path / "masks")
    assert [path.name for path in job.outputs["kept"].iterdir()] == ["1.png"]
    expected = np.zeros((30, 40), bool)
    expected[:, :21] = True
    np.testing.assert_array_equal(read_mask(job.outputs["kept"] / "1.png"), expected)
    assert job.warnings == ["2 of 3 photos have no mask and are used whole: 0.jpg, 2.jpg."]


def test_masks_that_fit_nothing_are_refused(make_job, tmp_path):
    write_png_srgb8(tmp_path / "images" / "a.png", np.full((60, 80, 3), 0.2))
    model = one_image_model("a.png", lens_of("SIMPLE_PINHOLE", 80, 60, 70, 40, 30))
    write_mask(tmp_path / "masks" / "b.png", np.ones((60, 80), bool))
    with pytest.raises(UserError, match="No mask in .* belongs to a photo"):
        undistort(make_job, tmp_path, model, tmp_path / "images", masks=tmp_path / "masks")
    write_mask(tmp_path / "masks" / "a.png", np.ones((30, 40), bool))
    with pytest.raises(UserError, match="mask .* is 40 × 30 pixels, its photo 80 × 60"):
        undistort(make_job, tmp_path, model, tmp_path / "images", out="two", masks=tmp_path / "masks")


def test_masks_that_keep_nothing_are_named_and_refused_where_all_are_so(make_job, tmp_path):
    for index in range(2):
        write_png_srgb8(tmp_path / "images" / f"{index}.png", np.full((60, 80, 3), 0.2))
        write_mask(tmp_path / "masks" / f"{index}.png", np.full((60, 80), index == 0))
    model = one_image_model("{}.png", lens_of("SIMPLE_PINHOLE", 80, 60, 70, 40, 30), 2)
    job = undistort(make_job, tmp_path, model, tmp_path / "images", masks=tmp_path / "masks")
    assert job.warnings == ["1 of 2 masks keep no pixel of their photos: 1.png."]
    ones = np.ones((60, 80), np.uint8)  # white in a program that counts classes, black in a photo's
    assert cv2.imwrite(str(tmp_path / "masks/0.png"), ones)
    with pytest.raises(UserError, match="No mask in .* keeps a pixel; expected white .* multiplied by 255"):
        undistort(make_job, tmp_path, model, tmp_path / "images", out="two", masks=tmp_path / "masks")


def test_what_lies_beyond_the_photo_is_not_kept(make_job, tmp_path):
    """With blank pixels allowed, a barrel lens leaves corners that no light reached."""
    write_png_srgb8(tmp_path / "images" / "a.png", np.full((60, 80, 3), 0.2))
    model = one_image_model("a.png", lens_of("SIMPLE_RADIAL", 80, 60, 70, 40, 30, -0.2))
    job = undistort(make_job, tmp_path, model, tmp_path / "images", UndistortSettings(blank_pixels=1.0))
    kept = read_mask(job.outputs["kept"] / "a.png")
    assert not kept.all() and kept[kept.shape[0] // 2, kept.shape[1] // 2]


@pytest.mark.parametrize(("focal", "k"), [(180, -0.2), (180, -0.12), (240, -0.2), (200, 0.1)])
def test_what_a_folded_lens_would_mirror_is_not_kept(make_job, tmp_path, focal, k):
    """Fitted to the middle, radial terms turn back before the corners of a wide photo."""
    ramp = np.broadcast_to(np.linspace(0, 1, 400)[:, None], (300, 400, 3))
    write_png_srgb8(tmp_path / "images" / "a.png", ramp)
    model = one_image_model("a.png", lens_of("SIMPLE_RADIAL", 400, 300, focal, 200, 150, k))
    job = undistort(make_job, tmp_path, model, tmp_path / "images")
    linear, kept = read_exr(job.outputs["linear"] / "a.exr")[..., 0], job.outputs["kept"] / "a.png"
    inside = read_mask(kept) if kept.exists() else np.ones(linear.shape, bool)
    middle = linear.shape[0] // 2
    across = linear[middle][inside[middle]]
    assert (np.diff(across) > -1e-3).all() and np.ptp(across) > 0.6


def test_a_photo_has_a_white_point_and_a_linear_image_has_none(make_job, tmp_path):
    """Saturated colours of a wide gamut are beyond 1 in both: values do not tell."""
    light = np.full((60, 80, 3), 1.2, np.float32)
    write_png_srgb8(tmp_path / "images" / "a.png", light)
    write_raw_exr(tmp_path / "linear" / "a.exr", light)
    for folder, name, white in (("images", "a.png", True), ("linear", "a.exr", False)):
        model = one_image_model(name, lens_of("SIMPLE_PINHOLE", 80, 60, 70, 40, 30))
        job = undistort(make_job, tmp_path, model, tmp_path / folder, out=folder + " undistorted")
        assert says_white(job.outputs["linear"] / "a.exr") == white


def test_pixels_that_are_no_numbers_are_not_kept(make_job, tmp_path):
    light = np.ones((60, 80, 3), np.float32)
    light[10, 20] = np.nan, 1, 1
    light[30, 40] = 1, np.inf, 1
    write_raw_exr(tmp_path / "images" / "a.exr", light)
    model = one_image_model("a.exr", lens_of("SIMPLE_PINHOLE", 80, 60, 70, 40, 30))
    job = undistort(make_job, tmp_path, model, tmp_path / "images")
    kept = read_mask(job.outputs["kept"] / "a.png")
    assert sorted(map(tuple, np.argwhere(~kept))) == [(10, 20), (30, 40)]
    assert np.isfinite(read_exr(job.outputs["linear"] / "a.exr")).all()


def test_a_photo_of_another_size_than_its_camera_is_refused(make_job, tmp_path):
    write_png_srgb8(tmp_path / "images" / "a.png", np.full((30, 40, 3), 0.2))
    model = one_image_model("a.png", lens_of("SIMPLE_PINHOLE", 80, 60, 70, 40, 30))
    with pytest.raises(UserError, match="40 × 30 pixels, but its camera in the model is 80 × 60"):
        undistort(make_job, tmp_path, model, tmp_path / "images")


def test_threads_do_not_change_a_bit(make_job, tmp_path):
    light = np.random.default_rng(2).random((130, 170, 3)).astype(np.float32)
    for index in range(3):
        write_exr(tmp_path / "images" / f"{index}.exr", light)
    model = one_image_model(
        "{}.exr", lens_of("OPENCV", 170, 130, 150, 151, 84, 66, 0.1, -0.02, 1e-3, 1e-3), 3
    )
    settings = UndistortSettings(max_size_px=80)
    jobs = [
        undistort(make_job, tmp_path, model, tmp_path / "images", settings, threads, out=str(threads))
        for threads in (1, 3)
    ]
    for name in ("workspace", "linear"):
        files = [path for path in jobs[0].outputs[name].rglob("*") if path.is_file()]
        assert files
        for file in files:
            other = jobs[1].outputs[name] / file.relative_to(jobs[0].outputs[name])
            assert file.read_bytes() == other.read_bytes(), file
