"""Photos without their light: lenses there and back, files that take their photos' place, the command."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
import tifffile
from PIL import Image
from scipy.ndimage import shift

from stages.delit_photos import DelitPhotosSettings, View, write_view
from stages.formats.colmap.model import cameras_of, read_model
from stages.formats.colour.icc_profiles import read_profile
from stages.formats.decoders.pictures import exif_of
from stages.formats.images.exr import read_exr, read_exr_alpha, write_exr
from stages.formats.images.photo_copies import name_of_copy, write_like
from stages.formats.images.photo_remarks import remarks_on
from stages.formats.images.photos import encode_srgb8, orientation_of, read_photo, write_mask
from stages.formats.images.resize import reduce_by_area
from stages.geometry.lenses import PhotoAndAlbedo, lens_of, pinhole_from_photo, through_pinhole
from stages.geometry.undistortion import bilinear
from stages.scene.cameras import Camera, project
from tests.rendered_scene import TINY, unshade, write_config
from tests.test_stories import actions

SIZE = 300, 220
LENSES = {
    "OPENCV": [260, 262, 148, 112, -0.15, 0.03, 0.001, -0.002],
    "SIMPLE_RADIAL": [260, 150, 110, -0.12],
    "RADIAL": [260, 150, 110, 0.1, -0.02],
    "OPENCV_FISHEYE": [200, 201, 151, 109, 0.02, -0.01, 0.001, 0.0],
    "SIMPLE_RADIAL_FISHEYE": [200, 150, 110, 0.01],
    "PINHOLE": [260, 262, 148, 112],
}
DETAILS, POSITION = 0x8769, 0x8825
EXPOSURE_TIME, ISO = 0x829A, 0x8827


def pinhole(lens: pycolmap.Camera) -> Camera:
    """All that an undistorted image of the lens can show."""
    ideal = pycolmap.undistort_camera(pycolmap.UndistortCameraOptions(blank_pixels=0), lens)
    return Camera("a", ideal.width, ideal.height, np.array(ideal.calibration_matrix()), np.eye(3, 4))


def lens_called(model: str) -> pycolmap.Camera:
    return pycolmap.Camera(model=model, width=SIZE[0], height=SIZE[1], params=LENSES[model])


def pattern(sigma_px: float = 2.0) -> np.ndarray:
    """Soft noise, (h, w, 3), that can be found again to a fraction of a pixel."""
    noise = np.random.default_rng(0).standard_normal((SIZE[1], SIZE[0])).astype(np.float32)
    soft = cv2.GaussianBlur(noise, (0, 0), sigma_px)
    return np.repeat((0.5 + 0.15 * soft / soft.std())[..., None], 3, axis=2).clip(0.05, 1).astype(np.float32)


def shifts(one: np.ndarray, other: np.ndarray, known: np.ndarray, side: int = 44) -> np.ndarray:
    """How far the pattern moved in every window that is known wholly, px, (n, 2), by its gradient."""
    found = []
    for top in range(0, len(one) - side, side):
        for left in range(0, one.shape[1] - side, side):
            place = np.s_[top : top + side, left : left + side]
            if known[place].all():
                down, right = np.gradient(((one + other) / 2)[place][..., 0])
                change = (one - other)[place][..., 0].ravel()
                slopes = np.stack([right.ravel(), down.ravel()], axis=1)
                found.append(np.linalg.lstsq(slopes, change, rcond=None)[0])
    return np.array(found)


def test_shifts_are_measured_to_hundredths_of_a_pixel():
    image = pattern()
    moved = shift(image, (-0.1, 0.25, 0), order=5)
    found = shifts(image[5:-5, 5:-5], moved[5:-5, 5:-5], np.ones((SIZE[1] - 10, SIZE[0] - 10), bool))
    assert np.abs(found - [0.25, -0.1]).max() < 0.02


@pytest.mark.parametrize("model", LENSES)
def test_a_pattern_that_was_undistorted_and_distorted_again_is_where_it_was(model):
    lens, image = lens_called(model), pattern()
    camera, everywhere = pinhole(lens), np.ones(SIZE[::-1], bool)
    straight, kept, _ = through_pinhole(image, everywhere, lens_of(lens), camera)
    place = pinhole_from_photo(lens_of(lens), camera)
    back, known = bilinear(straight, place), bilinear(kept.astype(np.float32), place) > 0.99
    moved = shifts(image, back, known)
    assert len(moved) >= 8
    assert np.abs(moved).max() < 0.1
    assert known.mean() > 0.7


@pytest.mark.parametrize("model", LENSES)
def test_a_photos_pixels_lie_in_the_pinhole_image_where_points_of_the_scene_do(model):
    """COLMAP projects points through the lens, our camera into the pinhole image."""
    lens = lens_called(model)
    camera = pinhole(lens)
    points = np.random.default_rng(1).uniform([-0.4, -0.3, 1], [0.4, 0.3, 1], (200, 3))
    in_photo = np.asarray(lens.img_from_cam(points), float)
    in_pinhole, _ = project(camera, points)
    place = pinhole_from_photo(lens_of(lens), camera)
    found = bilinear(place, in_photo[None].astype(np.float32))[0]
    assert np.abs(found - in_pinhole).max() < 0.05


def scene(folder: Path, lens: pycolmap.Camera, suffix: str, orientation: int = 1) -> tuple[View, np.ndarray]:
    """A photo through a lens, its albedo at half the size, and the true albedo in the photo's pixels."""
    truth = pattern()
    y, x = np.mgrid[: SIZE[1], : SIZE[0]] / SIZE[0]
    photo = (truth * (0.3 + 0.8 * x + 0.4 * y)[..., None]).astype(np.float32)
    camera, everywhere = pinhole(lens), np.ones(SIZE[::-1], bool)
    straight, kept, _ = through_pinhole(truth, everywhere, lens_of(lens), camera)
    half = camera.scaled(camera.width // 2, camera.height // 2)
    coarse = cv2.resize(straight, (half.width, half.height), interpolation=cv2.INTER_AREA)
    write_exr(folder / "albedo.exr", coarse)
    write_mask(folder / "mask.png", np.ones(half.shape, bool))
    exif = Image.Exif()
    exif[0x010F], exif[0x0112] = "A maker", orientation
    exif[DETAILS] = {EXPOSURE_TIME: 0.01, ISO: 200, 0x927C: b"maker's own"}
    exif[POSITION] = {1: "N", 2: (10.0, 20.0, 30.0)}
    name = folder / f"photos/a{suffix}"
    name.parent.mkdir(exist_ok=True)
    stored = photo if orientation == 1 else np.ascontiguousarray(np.rot90(photo))  # 6: turned clockwise
    if suffix in (".exr", ".hdr"):
        write_like(name, name, stored, None, 95, True)
    else:
        Image.fromarray(encode_srgb8(stored)).save(name, quality=98, exif=exif.tobytes())
    maps = folder / "albedo.exr", folder / "mask.png"
    view = View(
        of=PhotoAndAlbedo(name, name.name, False, lens_of(lens), half, *maps),
        picture=folder / "delit/images" / name_of_copy(name.name, False),
        white=2.0,
        settings=DelitPhotosSettings(),
    )
    return view, truth


def changed(view: View, **changes) -> View:
    """The view with other settings, and its picture with the suffix that they want."""
    settings = DelitPhotosSettings(**changes)
    name = name_of_copy(view.of.photo.name, settings.without_albedo == "alpha")
    return View(**{**vars(view), "settings": settings, "picture": view.picture.with_name(name)})


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".webp", ".exr", ".hdr"])
def test_the_albedo_takes_the_photos_place_in_its_own_pixels_and_kind(suffix, tmp_path):
    view, truth = scene(tmp_path, lens_called("OPENCV"), suffix)
    assert write_view(view) > 0.8
    assert view.picture.name == view.of.photo.name
    picture = read_photo(view.picture) * (1 if suffix in (".exr", ".hdr") else view.white)
    assert picture.shape == truth.shape
    inner = np.s_[30:-30, 40:-40]
    assert np.abs(picture - truth)[inner].mean() < 0.02
    known = np.zeros(SIZE[::-1], bool)
    known[inner] = True
    moved = shifts(truth, picture, known)
    assert len(moved) >= 6 and np.abs(moved).max() < 0.1
    if suffix in (".exr", ".hdr"):
        return
    exif = exif_of(view.picture)
    assert exif[0x010F] == "A maker"
    assert exif.get_ifd(POSITION)[2] == (10.0, 20.0, 30.0)
    details = exif.get_ifd(DETAILS)
    assert (details[EXPOSURE_TIME], details[ISO], details[0xA001]) == (0.01, 200, 1)
    assert 0x927C not in details
    with Image.open(view.picture) as image:
        profile = image.info.get("icc_profile")
    assert suffix == ".png" or read_profile(profile).to_srgb is not None
    assert remarks_on(view.picture, False, True) == []


def test_png_and_tiff_have_sixteen_bits_and_others_read_them(tmp_path):
    codes = []
    for suffix in (".png", ".tif"):
        (tmp_path / suffix).mkdir()
        view, _ = scene(tmp_path / suffix, lens_called("OPENCV"), suffix)
        write_view(view)
        codes.append(cv2.imread(str(view.picture), cv2.IMREAD_UNCHANGED))
        assert codes[-1].dtype == np.uint16
    assert np.array_equal(*codes)
    assert np.array_equal(tifffile.imread(view.picture), codes[1][..., ::-1])
    bitmap = pycolmap.Bitmap.read(view.picture, as_rgb=True)
    assert np.abs(bitmap.to_array().astype(int) - codes[1][..., ::-1] // 257).max() <= 1


@pytest.mark.parametrize("suffix", [".jpg", ".tif", ".png"])
def test_a_turned_photo_is_written_as_it_is_stored_with_its_tag(suffix, tmp_path):
    view, truth = scene(tmp_path, lens_called("OPENCV"), suffix, orientation=6)
    write_view(view)
    assert orientation_of(view.picture) == 6
    picture = read_photo(view.picture) * view.white
    assert picture.shape == truth.shape  # upright
    assert np.abs(picture - truth)[30:-30, 40:-40].mean() < 0.02
    assert read_photo(view.picture, as_stored=True).shape == (SIZE[0], SIZE[1], 3)


def test_undistorted_pictures_are_upright_and_of_the_pinhole_camera(tmp_path):
    view, truth = scene(tmp_path, lens_called("OPENCV"), ".jpg", orientation=6)
    view = changed(view, geometry="undistorted")
    write_view(view)
    lens = lens_called("OPENCV")
    straight, _, _ = through_pinhole(truth, np.ones(SIZE[::-1], bool), lens_of(lens), pinhole(lens))
    picture = read_photo(view.picture, as_stored=True) * view.white
    assert orientation_of(view.picture) == 1
    assert abs(picture.shape[0] - straight.shape[0]) <= 2 and abs(picture.shape[1] - straight.shape[1]) <= 2
    rows, columns = (min(a, b) for a, b in zip(picture.shape[:2], straight.shape[:2], strict=True))
    assert np.abs(picture[:rows, :columns] - straight[:rows, :columns]).mean() < 0.03


def test_where_there_is_no_albedo_stands_the_photo_or_black_or_nothing(tmp_path):
    view, truth = scene(tmp_path, lens_called("SIMPLE_RADIAL"), ".jpg")
    mask = np.ones(view.of.camera.shape, bool)
    mask[:, mask.shape[1] // 2 :] = False
    write_mask(view.of.mask, mask)
    photo = read_photo(view.of.photo)
    unknown = np.s_[:, SIZE[0] // 2 + 12 :]
    assert 0.3 < write_view(view) < 0.5
    assert np.abs(read_photo(view.picture) * view.white - photo)[unknown].mean() < 0.01
    black = changed(view, without_albedo="black")
    write_view(black)
    assert read_photo(black.picture)[unknown].max() < 0.01
    clear = changed(view, without_albedo="alpha")
    write_view(clear)
    assert clear.picture.name == "a.png"
    pixels = cv2.imread(str(clear.picture), cv2.IMREAD_UNCHANGED)
    assert (pixels[unknown][..., 3] == 0).all() and (pixels[60:160, 40:120, 3] == 65535).all()
    write_mask(view.of.mask, np.zeros_like(mask))
    assert write_view(view) == 0
    assert np.abs(read_photo(view.picture) * view.white - photo).mean() < 0.01


@pytest.mark.parametrize(
    ("name", "with_alpha", "copy"),
    [
        ("left/a.JPG", False, "left/a.JPG"),
        ("a.heic", False, "a.jpg"),
        ("a.dng", False, "a.tif"),
        ("a.avif", True, "a.png"),
        ("a.hdr", True, "a.exr"),
        ("a.b.tiff", True, "a.b.tiff"),
    ],
)
def test_a_kind_that_cannot_be_written_gets_another_ones_name(name, with_alpha, copy):
    assert name_of_copy(name, with_alpha) == copy


def test_transparent_copies_of_every_deep_kind_can_be_read(tmp_path):
    colour, opaque = pattern(), np.zeros(SIZE[::-1], bool)
    opaque[50:] = True
    for suffix in (".tif", ".webp", ".exr"):
        file = tmp_path / f"a{suffix}"
        write_like(file, file, colour, opaque, 95, True)
        if suffix == ".exr":
            assert np.array_equal(read_exr_alpha(file) > 0, opaque)
            continue
        with Image.open(file) as image:
            alpha = np.asarray(image.convert("RGBA").getchannel("A"))
        assert np.array_equal(alpha > 127, opaque), suffix


def test_exif_data_that_cannot_be_written_again_are_left_out(tmp_path):
    (tmp_path / "photo.jpg").write_bytes(b"no picture at all")
    write_like(tmp_path / "photo.jpg", tmp_path / "copy.jpg", pattern(), None, 95, True)
    assert dict(exif_of(tmp_path / "copy.jpg")) == {0x0112: 1}


def test_equal_pictures_are_equal_files(tmp_path):
    for suffix in (".jpg", ".png", ".tif", ".webp"):
        files = [tmp_path / f"{name}{suffix}" for name in "ab"]
        for file in files:
            write_like(tmp_path / "none.exr", file, pattern(), None, 95, True)
        assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.parametrize("geometry", ["original", "undistorted"])
def test_the_command_writes_them_on_demand_and_then_reuses_them(geometry, tmp_path, capsys):
    config = write_config(
        tmp_path / "scene.yaml",
        render=TINY | {"views": 2, "arc_deg": 20.0, "noise": 0.3, "width_px": 48, "height_px": 64},
        undistort={"max_size_px": 32},
        raycast={"reduce": 1},
        delit_photos={"geometry": geometry},
    )
    code, _, said = unshade(capsys, "run", config, "--delit-photos")
    assert code == 0, said
    delit = tmp_path / "w/output/delit"
    for name in ("000", "001"):
        small = read_exr(tmp_path / f"w/output/albedo/{name}.exr")
        large = read_exr(delit / f"images/{name}.exr")
        assert large.shape == (64, 48, 3)
        inside = read_exr(tmp_path / f"w/output/depth/{name}.exr") > 0
        off = np.abs(reduce_by_area(large, small.shape[:2]) - small)[inside]
        assert np.median(off) < 0.15 * small[inside].mean()
    assert (delit / "sparse").is_dir() == (geometry == "undistorted")
    if geometry == "undistorted":
        cameras = cameras_of(read_model(delit / "sparse"))
        assert [(camera.width, camera.height) for camera in cameras] == [(48, 64)] * 2
    code, told, _ = unshade(capsys, "plan", config, "--delit-photos", "--json")
    assert code == 0 and actions(told)["delit_photos"] == "reuse"
    code, _, said = unshade(capsys, "plan", config, "--delit-photos", "--to", "raycast")
    assert code == 2 and "--delit-photos and --to raycast were given" in said
