"""Structure from motion on photos whose poses are known, and on photos that ought not to work."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import get_args

import numpy as np
import pycolmap
import pytest
from PIL import Image

from benchmarks.fountain_poses import Poses, errors, model_poses
from benchmarks.similarity import similarity
from pipeline import UserError
from pipeline.config import check_settings
from stages.formats.colmap.model import read_model, registered
from stages.formats.images.exr import write_exr
from stages.formats.images.photos import encode_srgb8, encode_srgb16, write_png_srgb8
from stages.motion import matching
from stages.motion.database import copy_name
from stages.motion.features import in_full_photo
from stages.motion.mapping import attempts, free_principal_point
from stages.motion.matching import in_batches, sequential_pairs
from stages.motion.photo_set import Photo, camera_groups, exposure_for_matching, initial_cameras
from stages.motion.sfm_settings import CAMERA_PARAMS, MappingSettings, SfmSettings
from stages.scene.pairs import all_pairs
from stages.sfm import SFM
from tests import painted_corner

RADIAL = -0.05


@pytest.fixture(scope="module")
def views() -> list[tuple[painted_corner.Camera, np.ndarray]]:
    """Six cameras and their linear photos, 320 × 240."""
    sheets = painted_corner.paint(0)
    return [(c, painted_corner.render(c, sheets, RADIAL)) for c in painted_corner.cameras(6)]


@pytest.fixture(scope="module")
def folder(views, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("photos")
    for camera, linear in views:
        write_png_srgb8(folder / f"{camera.name}.png", linear)
    return folder


@pytest.fixture(scope="module")
def placed(make_job, folder, tmp_path_factory):
    """The six photos placed once, on two threads."""
    return run(make_job, tmp_path_factory.mktemp("placed"), folder)


def truth(views, extension=".png") -> Poses:
    return Poses(
        [camera.name + extension for camera, _ in views],
        np.array([camera.centre_in_world for camera, _ in views]),
        np.array([camera.rotation for camera, _ in views]),
    )


def run(make_job, out, images, threads=2, **settings):
    job = make_job(out, SFM, SfmSettings(**settings), threads, images=images)
    SFM.run(job)
    return job


def bytes_of(job) -> dict[str, bytes]:
    files = [*sorted(job.outputs["model"].iterdir()), job.outputs["database"]]
    return {file.name: file.read_bytes() for file in files}


def test_poses_lens_and_facts_are_right(placed, views):
    """Eq. 7: the poses are found up to a similarity."""
    job = placed
    centre_mm, rotation_deg = errors(model_poses(job.outputs["model"]), truth(views))
    assert centre_mm.max() < 5 and rotation_deg.max() < 0.8  # of 3.4 units distance, taken for metres
    model = read_model(job.outputs["model"])
    camera = model.cameras[1]
    assert (camera.width, camera.height) == (320, 240) and camera.model_name == "SIMPLE_RADIAL"
    assert abs(camera.focal_length - 300) < 3 and abs(camera.params[3] - RADIAL) < 0.02
    assert job.facts["registered"] == job.facts["photos"] == 6 and not job.warnings
    assert job.facts["points"] == model.num_points3D() > 500
    assert job.facts["mean_reprojection_error_px"] < 0.5
    colours = np.array([point.color for point in model.points3D.values()])
    assert colours.std(axis=0).min() > 10  # the paint, not black
    with closing(sqlite3.connect(job.outputs["database"])) as database:
        names = [name for (name,) in database.execute("SELECT name FROM images ORDER BY image_id")]
    assert names == [f"view_{i:02d}.png" for i in range(6)]


def test_the_same_bytes_on_one_thread_and_silence(make_job, tmp_path, folder, placed, capfd):
    """A second run, on another number of threads; and COLMAP's log stays off the terminal."""
    one = bytes_of(run(make_job, tmp_path, folder, threads=1))
    two = bytes_of(placed)
    assert capfd.readouterr() == ("", "")
    assert one.keys() == two.keys() and len(one) == 7
    for name in one:
        assert one[name] == two[name], name


def test_the_same_bytes_where_each_thread_matches_in_a_process_of_its_own(
    make_job, tmp_path, folder, placed, capfd, monkeypatch
):
    """Four processes for fifteen pairs; and COLMAP's log stays off the terminal there, too."""
    monkeypatch.setattr(matching, "FEWEST_FEATURES", 1)
    divided = run(make_job, tmp_path, folder, threads=4)
    assert bytes_of(divided) == bytes_of(placed)
    assert capfd.readouterr().err == ""
    assert not list(divided.scratch.glob("*.part"))


def test_every_kind_of_photo_takes_part_and_the_truncated_one_is_named(make_job, tmp_path, views):
    """Spaces, non-ASCII, sub-folders, grey, 16 bits, CMYK, EXIF rotation, another size; one cut in half."""
    photos = tmp_path / "alle fotos"
    eight = [encode_srgb8(linear) for _, linear in views]
    (photos / "a b").mkdir(parents=True)
    write_png_srgb8(photos / "a b" / "view 00.png", views[0][1])
    turned = Image.Exif()
    turned[0x0112] = 6  # stored turned left; to be turned clockwise
    Image.fromarray(np.rot90(eight[1])).save(photos / "été 01.jpg", quality=97, exif=turned)
    import cv2

    deep = cv2.imencode(".png", encode_srgb16(views[2][1])[..., ::-1])[1]
    (photos / "view_02.png").write_bytes(deep.tobytes())
    Image.fromarray(eight[3]).convert("CMYK").save(photos / "view_03.jpg", quality=97)
    Image.fromarray(eight[4]).convert("L").save(photos / "view_04.tif")
    larger = painted_corner.cameras(6, 400, 300, 375.0)[5]
    write_png_srgb8(photos / "view_05.PNG", painted_corner.render(larger, painted_corner.paint(0), RADIAL))
    Image.fromarray(eight[0]).save(photos / "cut.jpg")
    (photos / "cut.jpg").write_bytes((photos / "cut.jpg").read_bytes()[:9000])

    job = run(make_job, tmp_path / "out", photos)
    model = read_model(job.outputs["model"])
    names = ["a b/view 00.png", "view_02.png", "view_03.jpg", "view_04.tif", "view_05.PNG", "été 01.jpg"]
    assert [image.name for image in registered(model)] == names
    sizes = {image.name: model.cameras[image.camera_id] for image in registered(model)}
    assert {(c.width, c.height) for c in sizes.values()} == {(320, 240), (400, 300)}
    assert (sizes["view_05.PNG"].width, sizes["été 01.jpg"].width) == (400, 320)
    assert len(job.warnings) == 1 and "cut.jpg cannot be read" in job.warnings[0]
    assert (job.facts["photos"], job.facts["registered"]) == (6, 6)


def test_linear_photos_of_any_exposure_are_placed(make_job, tmp_path, views):
    for camera, linear in views[:3]:
        write_exr(tmp_path / "images" / f"{camera.name}.exr", linear * 250)
    job = run(make_job, tmp_path / "out", tmp_path / "images")
    assert job.facts["registered"] == 3


def test_known_intrinsics_are_held(make_job, tmp_path, folder, views):
    given = [300.0, 300.0, 160.0, 120.0, RADIAL, 0.0, 0.0, 0.0]
    job = run(make_job, tmp_path / "a", folder, camera_model="OPENCV", camera_params=given)
    camera = read_model(job.outputs["model"]).cameras[1]
    assert camera.params.tolist() == given
    _, rotation_deg = errors(model_poses(job.outputs["model"]), truth(views))
    assert rotation_deg.max() < 0.1


def test_the_global_mapper_agrees(make_job, tmp_path, folder, views):
    job = run(make_job, tmp_path, folder, mapper="global")
    centre_mm, _ = errors(model_poses(job.outputs["model"]), truth(views))
    assert job.facts["registered"] == 6 and "attempt" not in job.facts and centre_mm.max() < 20


def test_photos_that_do_not_belong_are_named_and_left_out(make_job, tmp_path, folder, views):
    rng = np.random.default_rng(9)
    for camera, linear in views[:4]:
        write_png_srgb8(tmp_path / "images" / f"{camera.name}.png", linear)
    write_png_srgb8(tmp_path / "images" / "elsewhere.png", rng.random((240, 320, 3)))
    job = run(make_job, tmp_path / "out", tmp_path / "images", attempts=1)
    assert job.facts["registered"] == 4
    assert job.warnings[:1] == ["1 of 5 photos could not be placed and are left out: elsewhere.png."]


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_photos_are_a_sentence(make_job, tmp_path, views, count):
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "K.txt").write_text("not a photo")
    for camera, linear in views[:count]:
        write_png_srgb8(tmp_path / "images" / f"{camera.name}.png", linear)
    expected = "There are no photos in .*Give the folder" if count == 0 else "one readable photo.*Add photos"
    with pytest.raises(UserError, match=expected):
        run(make_job, tmp_path / "out", tmp_path / "images")


def test_photos_whose_extra_is_missing_are_not_passed_over_in_silence(
    make_job, tmp_path, folder, monkeypatch
):
    monkeypatch.setattr("stages.formats.images.photo_folder.find_spec", lambda module: None)
    raws = tmp_path / "raws"
    raws.mkdir()
    (raws / "a.heic").write_bytes(b"")
    with pytest.raises(UserError, match="There are no photos in .* holds 1 .heic, which takes the extra"):
        run(make_job, tmp_path / "nothing", raws)
    (raws / "readable").symlink_to(folder)
    job = run(make_job, tmp_path / "out", raws)
    assert len(job.warnings) == 1 and "holds 1 .heic, which takes the extra" in job.warnings[0]


def test_only_one_readable_photo_is_a_sentence_too(make_job, tmp_path, views):
    write_png_srgb8(tmp_path / "images" / "a.png", views[0][1])
    (tmp_path / "images" / "b.png").write_bytes((tmp_path / "images" / "a.png").read_bytes()[:5000])
    with pytest.raises(UserError, match="holds one readable photo"):
        run(make_job, tmp_path / "out", tmp_path / "images")


def test_photos_without_overlap_are_a_sentence(make_job, tmp_path):
    """Different paint on every photo; and photos with nothing on them at all."""
    camera = painted_corner.cameras(1)[0]
    for seed in range(3):
        linear = painted_corner.render(camera, painted_corner.paint(100 + seed))
        write_png_srgb8(tmp_path / "strangers" / f"{seed}.png", linear)
        write_png_srgb8(tmp_path / "blank" / f"{seed}.png", np.full((240, 320, 3), 0.3 + 0.1 * seed))
    for kind in ("strangers", "blank"):
        with pytest.raises(
            UserError, match="3 photos of .* could not be placed: no two .* 20 .* add photos in between"
        ):
            run(make_job, tmp_path / f"out_{kind}", tmp_path / kind)


def test_camera_params_must_fit_the_model_before_anything_runs():
    """A list that does not is refused with the settings; the rest is as COLMAP has it."""
    given = {"camera_params": [300.0, 160.0, 120.0]}
    with pytest.raises(UserError, match="the 4 numbers of SIMPLE_RADIAL, .*: f, cx, cy, k.$"):
        check_settings({"sfm": SfmSettings}, {"sfm": given})
    with pytest.raises(UserError, match="^sfm.camera_model is 'NONE'; expected [^;]*$"):
        check_settings({"sfm": SfmSettings}, {"sfm": given | {"camera_model": "NONE"}})
    check_settings({"sfm": SfmSettings}, {"sfm": given | {"camera_model": "SIMPLE_PINHOLE"}})


@pytest.mark.parametrize("model", get_args(SfmSettings.model_fields["camera_model"].annotation))
def test_the_params_of_a_camera_model_are_those_that_colmap_has(model):
    params = list(map(float, range(300, 301 + CAMERA_PARAMS[model].count(","))))
    photos = [Photo("a.png", 320, 240, Path(copy_name(0)), None)]
    (camera,) = initial_cameras(photos, [0], model, params, 1.2)
    assert camera.params_info == CAMERA_PARAMS[model]
    assert camera.params.tolist() == params


def test_camera_params_hold_for_one_size_only():
    photos = [Photo("a.png", 320, 240, Path("0"), None), Photo("b.png", 240, 320, Path("1"), None)]
    with pytest.raises(UserError, match="one image size"):
        initial_cameras(photos, [0, 1], "PINHOLE", [300.0] * 4, 1.2)


def test_who_shares_a_camera():
    def photo(name: str, size: tuple[int, int], prior: float | None = None) -> Photo:
        return Photo(name, *size, Path(name), prior)

    land, port = (40, 30), (30, 40)
    photos = [
        photo("a/0", land),
        photo("a/1", land),
        photo("b/2", land),
        photo("b/3", port),
        photo("b/4", land, 99.0),
    ]
    assert camera_groups(photos, "shared") == [0, 0, 0, 1, 2]
    assert camera_groups(photos, "per_folder") == [0, 0, 1, 2, 3]
    assert camera_groups(photos, "per_image") == [0, 1, 2, 3, 4]
    cameras = initial_cameras(photos, [0, 0, 0, 1, 2], "SIMPLE_RADIAL", None, 1.2)
    assert [camera.focal_length for camera in cameras] == [48, 48, 99]
    assert [camera.has_prior_focal_length for camera in cameras] == [False, False, True]


def test_the_focal_length_of_exif_is_the_prior(tmp_path):
    """28 mm on a 43.27 mm diagonal (24 × 36); the photo's diagonal is 408.17 pixels: 28 / 43.27 × 408.17."""
    from stages.motion.photo_set import focal_prior

    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 28
    Image.new("RGB", (350, 210)).save(tmp_path / "p.jpg", exif=exif)
    assert focal_prior(tmp_path / "p.jpg") == pytest.approx(264.12, abs=0.01)
    Image.new("RGB", (350, 210)).save(tmp_path / "q.jpg")
    assert focal_prior(tmp_path / "q.jpg") is None


def test_one_exposure_for_the_whole_set():
    samples = [np.linspace(0, 50, 101), np.linspace(0, 200, 101), None, np.array([np.nan, np.inf])]
    photos = [Photo(str(i), 1, 1, Path("x"), None, sample) for i, sample in enumerate(samples)]
    assert exposure_for_matching(photos, 100.0) == pytest.approx(1 / 200)
    assert exposure_for_matching(photos[2:], 99.0) == 1.0


def test_keypoints_grow_with_the_photo():
    """The first pixel's centre in a copy at half size is the corner of four pixels: (0.5, 0.5) → (1, 1)."""
    small = np.array([[0.5, 0.5, 1, 2, 3, 4]], np.float32)
    np.testing.assert_allclose(in_full_photo(small, 2, 2), [[1, 1, 2, 4, 6, 8]])


def test_pairs():
    assert all_pairs(3) == [(0, 1), (0, 2), (1, 2)]
    assert [j for i, j in sequential_pairs(40, 3) if i == 0] == [1, 2, 3, 4, 8]
    batches = in_batches(all_pairs(40), 2)
    assert sorted(sum(batches, [])) == all_pairs(40) and max(map(len, batches)) == 256


def test_attempts_begin_with_colmaps_own_thresholds_and_loosen():
    tries = attempts(6, 5, MappingSettings())
    assert [a.seed for a in tries] == [5, 6, 7, 8, 9, 10]
    assert (tries[0].init_inliers, tries[0].init_angle_deg, tries[0].pose_inliers) == (100, 16, 30)
    assert all(a.init_inliers >= b.init_inliers for a, b in zip(tries, tries[1:], strict=False))


def test_the_principal_point_is_freed_only_within_its_gates():
    """A synthetic set taken with the principal point 20 pixels off, and a model that believes it centred."""
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=1, num_cameras_per_rig=1, num_frames_per_rig=8, num_points3D=150
    )
    pycolmap.set_random_seed(0)
    model = pycolmap.synthesize_dataset(options)
    camera = model.cameras[1]
    camera.principal_point_x -= 20
    before = np.array(camera.params)
    freed = free_principal_point(model, 0.03, 6)
    assert freed.refused is None and freed.shift_px == pytest.approx(20, abs=0.1)
    refused = free_principal_point(model, 0.01, 6)
    assert refused.model is model and "moved by 2.0% of the image" in refused.refused
    assert "no camera has 9 photos" in free_principal_point(model, 0.03, 9).refused
    np.testing.assert_array_equal(model.cameras[1].params, before)


def test_similarity_alignment_recovers_a_known_one():
    rng = np.random.default_rng(1)
    source = rng.normal(size=(7, 3))
    R = pycolmap.Rotation3d(np.array([0.1, -0.4, 0.2, 0.9]) / np.linalg.norm([0.1, -0.4, 0.2, 0.9])).matrix()
    target = 2.5 * source @ R.T + [1, 2, 3]
    fit = similarity(source, target)
    assert fit.scale == pytest.approx(2.5)
    np.testing.assert_allclose(fit.rotation, R, atol=1e-12)
    np.testing.assert_allclose(fit.shift, [1, 2, 3], atol=1e-12)
    np.testing.assert_allclose(fit.points(source), target, atol=1e-12)
    assert np.linalg.det(similarity(source, source * [1, 1, -1]).rotation) == pytest.approx(1)  # no mirror


HARD = MappingSettings(pose_inliers=(1000, 30), two_view_points=(False,))  # only a pair is placed at first


def test_photos_that_are_left_out_are_compared_again_along_epipolar_lines(
    make_job, tmp_path, folder, placed, monkeypatch
):
    """Only pairs of them: the two that were placed keep theirs. Bytes are the same on one thread."""
    monkeypatch.setattr(matching, "FEWEST_FEATURES", 1)
    two = run(make_job, tmp_path / "two", folder, threads=2, mapping=HARD)
    assert two.facts["registered"] == 6 and two.facts["attempt"] == 2
    before, after = (inliers(job.outputs["database"]) for job in (placed, two))
    kept = [pair for pair in before if after[pair] == before[pair]]
    assert two.facts["pairs_compared_again"] == len(before) - 1
    assert kept and all(after[pair] >= count for pair, count in before.items())
    assert sum(after.values()) > 1.1 * sum(before.values())
    one = bytes_of(run(make_job, tmp_path / "one", folder, threads=1, mapping=HARD))
    assert one == bytes_of(two)


def test_photos_are_not_compared_again_where_that_is_not_wanted(make_job, tmp_path, folder, placed):
    job = run(make_job, tmp_path, folder, mapping=HARD, guided_matching=False)
    assert job.facts["registered"] == 6 and job.facts["attempt"] == 2
    assert "pairs_compared_again" not in job.facts
    assert job.outputs["database"].read_bytes() == placed.outputs["database"].read_bytes()


def inliers(database: Path) -> dict[int, int]:
    """Verified matches of each pair."""
    with closing(sqlite3.connect(database)) as opened:
        return dict(opened.execute("SELECT pair_id, rows FROM two_view_geometries WHERE rows > 0"))


@pytest.mark.slow
def test_a_set_that_barely_connects_is_placed_whole(make_job, tmp_path, data_folder):
    """Every second photo of eleven: by the first matches, four of six."""
    images = tmp_path / "images"
    images.mkdir()
    for photo in sorted((data_folder / "photos-bundler-kermit").glob("*.jpg"))[::2]:
        (images / photo.name).symlink_to(photo)
    assert run(make_job, tmp_path / "again", images).facts["registered"] == 6
    assert run(make_job, tmp_path / "once", images, guided_matching=False).facts["registered"] < 6


@pytest.mark.slow
def test_fountain_is_placed_as_well_as_promised(make_job, tmp_path, data_folder):
    """Camera centres within 5 mm, rotations within 0.1° of the ground truth, on average."""
    from benchmarks.fountain_poses import true_poses

    fountain = data_folder / "fountain-P11"
    job = run(make_job, tmp_path / "out", fountain / "images")
    assert job.facts["registered"] == 11
    centre_mm, rotation_deg = errors(
        model_poses(job.outputs["model"]), true_poses(fountain / "gt_dense_cameras")
    )
    assert centre_mm.mean() <= 5 and rotation_deg.mean() <= 0.1
