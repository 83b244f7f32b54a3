"""COLMAP models: found, distrusted, rebuilt, adopted."""

from __future__ import annotations

import shutil
import unicodedata

import numpy as np
import pycolmap
import pytest

from pipeline import UserError
from stages.adopt_model import ADOPT_MODEL
from stages.formats.colmap.model import (
    cameras_of,
    check_image_name,
    find_model,
    pinhole_model,
    read_model,
    registered,
)
from stages.formats.images.photos import write_png_srgb8
from stages.scene.cameras import project

WIDTH, HEIGHT = 120, 90
NO_SPACES = [f"sub/photo_{index}.jpg" for index in range(4)]  # COLMAP's text files cut names at a space


def distorted_model(count: int = 4, names: list[str] | None = None, seed: int = 0) -> pycolmap.Reconstruction:
    """A model with exact observations: a SIMPLE_RADIAL lens, `count` images, forty points."""
    rng = np.random.default_rng(seed)
    lens = pycolmap.Camera(
        camera_id=7, model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, params=[100.0, 61, 44, 0.1]
    )
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(lens)
    x_in_world = rng.uniform(-1, 1, (40, 3)) + [0, 0, 5]
    tracks = [pycolmap.Track() for _ in x_in_world]
    for index in range(count):
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(), rng.uniform(-0.3, 0.3, 3))
        name = names[index] if names else f"sub/photo {index}.jpg"
        image = pycolmap.Image(name=name, camera_id=7, image_id=10 + index)
        xy = lens.img_from_cam(x_in_world + pose.translation)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(point) for point in xy])
        model.add_image_with_trivial_frame(image, pose)
        for point, track in enumerate(tracks):
            track.add_element(10 + index, point)
    for x, track in zip(x_in_world, tracks, strict=True):
        model.add_point3D(x, track, np.array([1, 2, 3], np.uint8))
    return model


def write(model: pycolmap.Reconstruction, folder, text: bool = False):
    folder.mkdir(parents=True, exist_ok=True)
    (model.write_text if text else model.write)(folder)
    return folder


@pytest.mark.parametrize("where", [".", "sparse", "sparse/0", "0", "sparse/3"])
@pytest.mark.parametrize("text", [False, True])
def test_a_model_is_found_in_any_layout(tmp_path, where, text):
    write(distorted_model(names=NO_SPACES), tmp_path / where, text)
    assert find_model(tmp_path) == tmp_path / where
    assert len(registered(read_model(find_model(tmp_path)))) == 4


def test_of_several_numbered_models_the_largest_is_taken_and_the_first_of_equals(tmp_path):
    for number, count in enumerate([2, 4, 4, 3]):
        write(distorted_model(count), tmp_path / "sparse" / str(number), text=number % 2 == 0)
    assert find_model(tmp_path) == tmp_path / "sparse" / "1"


def test_no_model_and_a_broken_model_are_said(tmp_path):
    with pytest.raises(UserError, match="no COLMAP model in .*expected cameras and images"):
        find_model(tmp_path)
    write(distorted_model(), tmp_path)
    (tmp_path / "images.bin").write_bytes((tmp_path / "images.bin").read_bytes()[:200])
    with pytest.raises(UserError, match="images.bin promises 4 images and ends .*export the model again"):
        read_model(tmp_path)


@pytest.mark.parametrize("text", [False, True])
def test_a_model_without_points_is_fine_with_and_without_the_file(tmp_path, text):
    cameras = cameras_of(pinhole_model(cameras_of(undistorted(NO_SPACES))))
    write(pinhole_model(cameras), tmp_path, text)
    assert read_model(tmp_path).num_points3D() == 0
    (tmp_path / ("points3D.txt" if text else "points3D.bin")).unlink()
    assert len(cameras_of(read_model(tmp_path))) == 4


@pytest.mark.parametrize("name", ["../a.jpg", "/etc/a.jpg", "a/../../b.jpg", "C:/a.jpg", "a\\b.jpg", ""])
def test_names_that_leave_the_folder_are_refused(tmp_path, name):
    with pytest.raises(UserError, match="leads out of the image folder"):
        check_image_name(name, "somewhere")
    if name:
        write(distorted_model(2, [name, "ok.jpg"]), tmp_path)
        with pytest.raises(UserError, match="leads out of the image folder"):
            read_model(tmp_path)


def test_honest_names_pass():
    for name in ("a.jpg", "a b/ü.jpg", "a../b..jpg", "a-/-.b.png"):
        check_image_name(name, "somewhere")


def test_two_images_of_one_view_name_are_refused(tmp_path):
    write(distorted_model(2, ["a.jpg", "a.png"]), tmp_path)
    with pytest.raises(UserError, match=r"a\.jpg and a\.png"):
        read_model(tmp_path)


@pytest.mark.parametrize("text", [False, True])
def test_two_images_of_one_name_are_refused(tmp_path, text):
    write(distorted_model(2, ["a.jpg", "b.jpg"]), tmp_path, text)
    rename_in(tmp_path, b"b.jpg", b"a.jpg")
    with pytest.raises(UserError, match=r"a\.jpg and a\.jpg"):
        read_model(tmp_path)


@pytest.mark.parametrize("text", [False, True])
def test_names_that_are_not_utf_8_are_refused(tmp_path, text):
    folder = write(distorted_model(2, ["a.jpg", "b.jpg"]), tmp_path / "sparse" / "0", text)
    rename_in(folder, b"b.jpg", b"\xe9.jpg")
    assert find_model(tmp_path) == folder
    with pytest.raises(UserError, match=r"named b'\\xe9\.jpg'; names must be UTF-8"):
        read_model(folder)


def rename_in(folder, before: bytes, after: bytes) -> None:
    """Another name for an image of a written model, in bytes: pycolmap itself writes neither kind."""
    (images,) = folder.glob("images.*")
    images.write_bytes(images.read_bytes().replace(before, after))


def undistorted(names: list[str] | None = None) -> pycolmap.Reconstruction:
    model = distorted_model(names=names)
    pinhole = pycolmap.undistort_camera(pycolmap.UndistortCameraOptions(), model.cameras[7])
    cameras = [
        camera_from(image, pinhole.width, pinhole.height, pinhole.calibration_matrix())
        for image in registered(model)
    ]
    return pinhole_model(cameras, points_from=model)


def camera_from(image, width, height, intrinsics):
    from stages.scene.cameras import Camera

    return Camera(image.name[:-4], width, height, intrinsics, image.cam_from_world().matrix())


def test_a_pinhole_model_keeps_points_and_tracks_and_its_observations_agree():
    """The carried 2-D points are where Eq. 7 projects the points: to rounding, through another lens model."""
    source, model = distorted_model(), undistorted()
    assert model.num_points3D() == 40 and model.is_valid()
    assert {c.model_name for c in model.cameras.values()} == {"PINHOLE"} and model.num_cameras() == 1
    for camera, image in zip(cameras_of(model), registered(model), strict=True):
        assert image.name == camera.name + ".png"
        observed = np.array([point.xy for point in image.points2D])
        x_in_world = np.array([model.points3D[point.point3D_id].xyz for point in image.points2D])
        xy, depth = project(camera, x_in_world)
        assert (depth > 0).all()
        np.testing.assert_allclose(observed, xy, atol=1e-6)
    assert [i.image_id for i in registered(model)] == [i.image_id for i in registered(source)]


def test_points_that_one_view_alone_still_sees_are_dropped():
    model = undistorted()
    assert pinhole_model(cameras_of(model)[:2], points_from=model).num_points3D() == 40
    assert pinhole_model(cameras_of(model)[:1], points_from=model).num_points3D() == 0


def test_cameras_of_a_distorted_model_are_refused():
    with pytest.raises(ValueError, match="SIMPLE_RADIAL"):
        cameras_of(distorted_model())


def test_writing_twice_gives_the_same_bytes(tmp_path):
    for run in ("a", "b"):
        write(undistorted(), tmp_path / run)
    for file in sorted((tmp_path / "a").iterdir()):
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes(), file.name


# adopt_model


def photos(folder, names, width=WIDTH, height=HEIGHT):
    for name in names:
        write_png_srgb8(folder / name, np.full((height, width, 3), 0.5, np.float32))
    return folder


def adopt(make_job, tmp_path, model, images):
    colmap = write(model, tmp_path / "colmap" / "sparse" / "0")
    job = make_job(tmp_path / "out", ADOPT_MODEL, colmap=colmap.parent.parent, images=images)
    ADOPT_MODEL.run(job)
    return job, read_model(job.outputs["model"])


def test_adoption_follows_the_photos_names_whatever_the_extension(make_job, tmp_path):
    images = photos(tmp_path / "images", [f"sub/photo {i}.png" for i in range(4)])
    job, model = adopt(make_job, tmp_path, distorted_model(), images)
    assert [image.name for image in registered(model)] == [f"sub/photo {i}.png" for i in range(4)]
    assert model.num_points3D() == 40 and not job.warnings
    assert model.cameras[1].params.tolist() == [100, 61, 44, 0.1]
    assert job.facts["camera_models"] == ["SIMPLE_RADIAL"]


def test_adoption_takes_accents_however_they_are_spelled(make_job, tmp_path):
    model, composed = distorted_model(), unicodedata.normalize("NFC", "façade {}.png")
    for number, image in enumerate(model.images.values()):
        image.name = unicodedata.normalize("NFD", composed.format(number))
    images = photos(tmp_path / "images", [composed.format(number) for number in range(4)])
    job, adopted = adopt(make_job, tmp_path, model, images)
    assert [image.name for image in registered(adopted)] == [composed.format(number) for number in range(4)]
    assert not job.warnings


def test_missing_photos_are_named_and_the_rest_is_adopted(make_job, tmp_path):
    images = photos(tmp_path / "images", ["sub/photo 0.png", "sub/photo 2.png"])
    job, model = adopt(make_job, tmp_path, distorted_model(), images)
    assert len(registered(model)) == 2 and model.num_points3D() == 40
    assert "2 of the 4 images" in job.warnings[0] and "sub/photo 1.jpg, sub/photo 3.jpg" in job.warnings[0]


def test_no_photo_at_all_is_a_sentence(make_job, tmp_path):
    images = photos(tmp_path / "images", ["other.png"])
    with pytest.raises(UserError, match=r"No photo in .*expected sub/photo 0\.jpg"):
        adopt(make_job, tmp_path, distorted_model(), images)


def test_photos_at_another_size_rescale_the_camera_and_the_points_aloud(make_job, tmp_path):
    """At double size every pixel coordinate doubles: COLMAP's centres at 0.5 make it a product."""
    images = photos(tmp_path / "images", [f"sub/photo {i}.png" for i in range(4)], 2 * WIDTH, 2 * HEIGHT)
    job, model = adopt(make_job, tmp_path, distorted_model(), images)
    assert model.cameras[1].params.tolist() == [200, 122, 88, 0.1]
    assert "4 photos have another size" in job.warnings[0]
    model.update_point_3d_errors()
    assert model.compute_mean_reprojection_error() < 1e-9


def test_photos_of_another_shape_are_refused(make_job, tmp_path):
    images = photos(tmp_path / "images", [f"sub/photo {i}.png" for i in range(4)], HEIGHT, WIDTH)
    with pytest.raises(UserError, match="90 × 120 pixels, but its camera in the model is 120 × 90; .*EXIF"):
        adopt(make_job, tmp_path, distorted_model(), images)
    shutil.rmtree(tmp_path / "images")
    shutil.rmtree(tmp_path / "out")
    images = photos(tmp_path / "images", [f"sub/photo {i}.png" for i in range(4)], WIDTH, WIDTH)
    with pytest.raises(UserError, match="give the photos that the model was made from"):
        adopt(make_job, tmp_path, distorted_model(), images)


def test_a_panorama_is_refused(make_job, tmp_path):
    model = distorted_model()
    model.cameras[7].model = pycolmap.CameraModelId.EQUIRECTANGULAR
    model.cameras[7].params = [float(WIDTH), HEIGHT]
    images = photos(tmp_path / "images", [f"sub/photo {i}.png" for i in range(4)])
    with pytest.raises(UserError, match="EQUIRECTANGULAR .*sees all around; .*Cut the panoramas"):
        adopt(make_job, tmp_path, model, images)


def test_impossible_cameras_are_refused(make_job, tmp_path):
    model = distorted_model()
    model.cameras[7].params = [float("nan"), 61, 44, 0.1]
    images = photos(tmp_path / "images", [f"sub/photo {i}.png" for i in range(4)])
    with pytest.raises(UserError, match="impossible parameters"):
        adopt(make_job, tmp_path, model, images)
