"""Cameras of other programs: each format, from its own definition, shows points where COLMAP's model does."""

from __future__ import annotations

import json
import math
import unicodedata
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from pipeline import UserError
from stages.adopt_cameras import ADOPT_CAMERAS, AdoptCamerasSettings
from stages.formats.cameras.camera_files import read_posed_photos
from stages.formats.cameras.colmap_model import model_of_posed_photos
from stages.formats.cameras.photo_paths import photo_of_each_path
from stages.formats.cameras.transforms_json import write_transforms
from stages.formats.colmap.model import cameras_of, read_model, registered
from stages.formats.images.photos import write_png_srgb8
from stages.scene.cameras import Camera
from stages.scene.poses import inverse, nearest_rotation, with_flipped_camera_axes

WIDTH, HEIGHT, FX, FY, CX, CY = 120, 90, 100.0, 104.0, 63.0, 42.0
K1, K2, K3, P1, P2 = -0.11, 0.04, -0.013, 0.004, -0.007
CENTRE = np.array([0.4, -0.3, -1.2])
X_IN_WORLD = np.random.default_rng(0).uniform(-0.8, 0.8, (50, 3)) + [0, 0, 2]


def rotation() -> np.ndarray:
    """cam_from_world, away from every axis."""
    return np.asarray(pycolmap.Rotation3d(np.array([0.1, -0.15, 0.3])).matrix())


def in_cam() -> np.ndarray:
    """The points in the camera: x right, y down, z forward."""
    return (X_IN_WORLD - CENTRE) @ rotation().T


def brown(xy: np.ndarray, k: tuple[float, float, float], p: tuple[float, float]) -> np.ndarray:
    """OpenCV's distortion, written out."""
    x, y = xy.T
    r2 = x**2 + y**2
    radial = 1 + k[0] * r2 + k[1] * r2**2 + k[2] * r2**3
    return np.stack(
        [
            x * radial + 2 * p[0] * x * y + p[1] * (r2 + 2 * x**2),
            y * radial + p[0] * (r2 + 2 * y**2) + 2 * p[1] * x * y,
        ],
        axis=1,
    )


def world_from_cam_gl() -> list[list[float]]:
    """A NeRF's matrix: columns right, up, backward, place."""
    right, down, forward = rotation()
    return [*np.column_stack([right, -down, -forward, CENTRE]).tolist(), [0, 0, 0, 1]]


def transforms(folder: Path) -> tuple[Path, np.ndarray]:
    frame = {"file_path": "images/a.png", "transform_matrix": world_from_cam_gl()}
    lens = {"w": WIDTH, "h": HEIGHT, "fl_x": FX, "fl_y": FY, "cx": CX, "cy": CY}
    lens |= {"k1": K1, "k2": K2, "p1": P1, "p2": P2, "camera_model": "OPENCV"}
    xy = brown(in_cam()[:, :2] / in_cam()[:, 2:], (K1, K2, 0), (P1, P2))
    return written(folder / "transforms.json", {**lens, "frames": [frame]}), xy * [FX, FY] + [CX, CY]


def blender(folder: Path) -> tuple[Path, np.ndarray]:
    """NeRF's synthetic scenes: an angle of view, no size, no extension."""
    frame = {"file_path": "./train/a", "transform_matrix": world_from_cam_gl()}
    focal = WIDTH / 2 / math.tan(0.5)
    xy = in_cam()[:, :2] / in_cam()[:, 2:] * focal + [WIDTH / 2, HEIGHT / 2]
    return written(folder / "transforms_train.json", {"camera_angle_x": 1.0, "frames": [frame]}), xy


def bundler(folder: Path) -> tuple[Path, np.ndarray]:
    """p = −P / P.z, f r(p) p, y up, from the middle of the image; the second camera has no pose."""
    R = np.diag([1, -1, -1]) @ rotation()
    P = X_IN_WORLD @ R.T - R @ CENTRE
    p = -P[:, :2] / P[:, 2:]
    r2 = (p**2).sum(axis=1, keepdims=True)
    xy = FX * (1 + K1 * r2 + K2 * r2**2) * p
    rows = [[FX, K1, K2], *R, -R @ CENTRE, *np.zeros((5, 3))]
    text = "\n".join(" ".join(f"{one:.17g}" for one in row) for row in rows)
    path = folder / "bundle.out"
    path.write_text(f"# Bundle file v0.3\n2 0\n{text}\n")
    (folder / "list.txt").write_text("./a.png 0 100.0\n./b.png\n")
    return path, np.stack([WIDTH / 2 + xy[:, 0], HEIGHT / 2 - xy[:, 1]], axis=1)


def middlebury(folder: Path) -> tuple[Path, np.ndarray]:
    """K, R, t; pixels are counted from the first one's centre."""
    K = np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1]])
    values = [*K.ravel(), *rotation().ravel(), *(-rotation() @ CENTRE)]
    path = folder / "a_par.txt"
    path.write_text("1\na.png " + " ".join(f"{one:.17g}" for one in values) + "\n")
    return path, in_cam()[:, :2] / in_cam()[:, 2:] * [FX, FY] + [CX + 0.5, CY + 0.5]


def projections(folder: Path) -> tuple[Path, np.ndarray]:
    """A file of P for each photo, of any scale and sign, as PMVS has them."""
    K = np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1]])
    P = -3 * K @ np.column_stack([rotation(), -rotation() @ CENTRE])
    (folder / "txt").mkdir()
    (folder / "txt/a.txt").write_text("CONTOUR\n" + "\n".join(" ".join(map(repr, row.tolist())) for row in P))
    x = np.column_stack([X_IN_WORLD, np.ones(len(X_IN_WORLD))]) @ P.T
    return folder / "txt", x[:, :2] / x[:, 2:] + 0.5


def meshroom(folder: Path) -> tuple[Path, np.ndarray]:
    lens = {"intrinsicId": "7", "width": "120", "height": "90", "sensorWidth": "36", "type": "brown"}
    lens |= {"focalLength": repr(FX * 36 / WIDTH), "pixelRatio": repr(FY / FX)}
    lens |= {"principalPoint": ["3", "-3"], "distortionParams": list(map(repr, (K1, K2, K3, P1, P2)))}
    place = {
        "rotation": [repr(float(one)) for one in rotation().T.ravel()],
        "center": list(map(repr, CENTRE.tolist())),
    }
    view = {"viewId": "1", "poseId": "5", "intrinsicId": "7", "path": "C:\\photos\\a.PNG"}
    lost = {"viewId": "2", "poseId": "6", "intrinsicId": "7", "path": "C:\\photos\\b.PNG"}
    document = {"version": ["1", "2", "6"], "views": [view, lost], "intrinsics": [lens]}
    document |= {"poses": [{"poseId": "5", "pose": {"transform": place}}]}
    xy = brown(in_cam()[:, :2] / in_cam()[:, 2:], (K1, K2, K3), (P1, P2))
    return written(folder / "cameras.sfm", document), xy * [FX, FY] + [WIDTH / 2 + 3, HEIGHT / 2 - 3]


def metashape(folder: Path) -> tuple[Path, np.ndarray]:
    """u = w/2 + cx + x' (f + b1), v = h/2 + cy + y' f; P1 goes with r² + 2x². The chunk is turned."""
    turned, moved, scale = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([1.0, 2, 3]), 2.5
    chunk_from_cam = np.eye(4)
    chunk_from_cam[:3, :3] = turned.T @ rotation().T
    chunk_from_cam[:3, 3] = turned.T @ (CENTRE - moved) / scale
    calibration = {
        "f": FY,
        "cx": 3,
        "cy": -3,
        "b1": FX - FY,
        "k1": K1,
        "k2": K2,
        "k3": K3,
        "p1": P2,
        "p2": P1,
    }
    numbers = "".join(f"<{name}>{value!r}</{name}>" for name, value in calibration.items())
    path = folder / "cameras.xml"
    path.write_text(
        f"""<?xml version="1.0" encoding="UTF-8"?><document version="1.5.0"><chunk label="Chunk 1">
        <sensors><sensor id="0" type="frame"><resolution width="120" height="90"/>
        <calibration type="frame" class="initial"><f>1</f></calibration>
        <calibration class="adjusted"><resolution width="120" height="90"/>{numbers}</calibration>
        </sensor></sensors><cameras>
        <camera id="0" sensor_id="0" label="a"><transform>{listed(chunk_from_cam)}</transform></camera>
        <camera id="1" sensor_id="0" label="b"/>
        <group><camera id="2" sensor_id="0" label="c" enabled="false">
        <transform>{listed(np.eye(4))}</transform></camera></group></cameras>
        <reference>LOCAL_CS["Local Coordinates (m)"]</reference>
        <transform><rotation>{listed(turned)}</rotation><translation>{listed(moved)}</translation>
        <scale>{scale}</scale></transform></chunk></document>"""
    )
    xy = brown(in_cam()[:, :2] / in_cam()[:, 2:], (K1, K2, K3), (P1, P2))
    return path, xy * [FX, FY] + [WIDTH / 2 + 3, HEIGHT / 2 - 3]


def listed(values: np.ndarray) -> str:
    return " ".join(repr(float(one)) for one in values.ravel())


def written(path: Path, document: dict) -> Path:
    path.write_text(json.dumps(document))
    return path


DOORS = [transforms, blender, bundler, middlebury, projections, meshroom, metashape]


@pytest.fixture
def photos(tmp_path) -> Path:
    folder = tmp_path / "photos"
    for name in ("a.png", "b.png"):
        write_png_srgb8(folder / name, np.full((HEIGHT, WIDTH, 3), 0.5, np.float32))
    return folder


def adopted(make_job, folder: Path, path: Path, photos: Path, **settings) -> pycolmap.Reconstruction:
    """The stage itself, done."""
    listed_beside = {"photo_list": path.parent / "list.txt"} if path.suffix == ".out" else {}
    inputs = {"camera_file": path, "images": photos, **listed_beside}
    job = make_job(folder / "out", ADOPT_CAMERAS, AdoptCamerasSettings(**settings), **inputs)
    ADOPT_CAMERAS.run(job)
    return read_model(job.outputs["model"])


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.__name__)
def test_points_are_seen_where_the_format_s_own_definition_puts_them(door, make_job, tmp_path, photos):
    path, xy = door(tmp_path)
    model = adopted(make_job, tmp_path, path, photos)
    (image,) = registered(model)
    camera = model.cameras[image.camera_id]
    assert (image.name, camera.width, camera.height) == ("a.png", WIDTH, HEIGHT)
    seen = camera.img_from_cam(image.cam_from_world() * X_IN_WORLD)
    np.testing.assert_allclose(seen, xy, atol=1e-6)
    assert model.num_points3D() == 0


@pytest.mark.parametrize(("first_px", "shift"), [(0.5, 0.0), (1.0, -0.5)])
def test_plain_matrices_may_count_pixels_otherwise(first_px, shift, make_job, tmp_path, photos):
    model = adopted(make_job, tmp_path, middlebury(tmp_path)[0], photos, first_pixel_px=first_px)
    np.testing.assert_allclose(model.cameras[1].params, [FX, FY, CX + shift, CY + shift])


@pytest.mark.parametrize("fisheye", ["meshroom", "metashape", "transforms", "instant-ngp"])
def test_a_fisheye_bends_by_the_angle_from_its_axis(fisheye, make_job, tmp_path, photos):
    """θ (1 + k₁ θ² + k₂ θ⁴ + k₃ θ⁶) from the principal point, in all programs."""
    if fisheye == "metashape":
        path = metashape(tmp_path)[0]
        text = path.read_text().replace('type="frame"', 'type="fisheye"')
        path.write_text(text.replace(f"<p1>{P2!r}</p1>", "").replace(f"<p2>{P1!r}</p2>", ""))
    elif fisheye == "meshroom":
        path = meshroom(tmp_path)[0]
        path.write_text(path.read_text().replace('"brown"', '"fisheye4"').replace(f'"{P1!r}", ', '"0", '))
    else:
        path = transforms(tmp_path)[0]
        document = json.loads(path.read_text()) | {"k3": K3, "p1": 0, "p2": 0}
        named = fisheye == "transforms"
        document |= {"camera_model": "OPENCV_FISHEYE"} if named else {"is_fisheye": True}
        document = document if named else {k: v for k, v in document.items() if k != "camera_model"}
        written(path, document)
    model = adopted(make_job, tmp_path, path, photos)
    (image,) = registered(model)
    xy = in_cam()[:, :2] / in_cam()[:, 2:]
    r = np.linalg.norm(xy, axis=1, keepdims=True)
    theta = np.arctan(r)
    bent = xy / r * theta * (1 + K1 * theta**2 + K2 * theta**4 + K3 * theta**6)
    seen = model.cameras[image.camera_id].img_from_cam(image.cam_from_world() * X_IN_WORLD)
    np.testing.assert_allclose(seen, bent * [FX, FY] + [CX, CY], atol=1e-6)


@pytest.mark.parametrize(
    "radial",
    [
        (-0.0919367147, -0.0762807468, 0.1162639394, -0.0761413904),  # of a drone, as Metashape calibrates it
        (-0.28, 0.12, -0.03, 0.01),
        (0.05, -0.2, 0.3, -0.15),
    ],
)
def test_radial_terms_of_the_eighth_power_become_a_ratio_that_bends_as_they_do(
    radial, make_job, tmp_path, photos
):
    """COLMAP has none of r⁸, which moves the corners of a wide photo by a hundred pixels."""
    k1, k2, k3, k4 = radial
    lens = f"<f>90</f><k1>{k1}</k1><k2>{k2}</k2><k3>{k3}</k3><k4>{k4}</k4><p1>{P2!r}</p1><p2>{P1!r}</p2>"
    path = metashape(tmp_path)[0]
    text = path.read_text()
    begin = text.index("<f>", text.index("adjusted"))
    end = text.index("</calibration>", begin)
    path.write_text(text[:begin] + lens + text[end:])
    model = adopted(make_job, tmp_path, path, photos)
    (camera,) = model.cameras.values()
    assert camera.model_name == "FULL_OPENCV"
    across, down = np.meshgrid(
        np.linspace(-0.5, 0.5, 9) * WIDTH / 90, np.linspace(-0.5, 0.5, 9) * HEIGHT / 90
    )
    xy = np.stack([across.ravel(), down.ravel()], axis=1)
    r2 = (xy**2).sum(axis=1, keepdims=True)
    bent = xy * (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4)
    bent += 2 * np.array([P1, P2]) * xy.prod(axis=1, keepdims=True) + np.array([P2, P1]) * (r2 + 2 * xy**2)
    seen = camera.img_from_cam(np.column_stack([xy, np.ones(len(xy))]))
    apart = np.linalg.norm(seen - (bent * 90 + camera.params[2:4]), axis=1)
    assert apart.max() < 2.5e-5 * 90  # px: a tenth of one in a photo of 4000


def test_a_component_of_metashape_has_the_chunk_s_place(make_job, tmp_path, photos):
    """As files of Metashape 2 have it; the cameras are the same."""
    path = metashape(tmp_path)[0]
    before = adopted(make_job, tmp_path, path, photos).images[1].cam_from_world()
    text = path.read_text()
    begin, end = text.rindex("<transform><rotation>"), text.rindex("</chunk>")
    components = f"""<components><component id="4">{text[begin:end]}</component></components>"""
    text = text[:begin] + components + text[end:]
    path.write_text(text.replace('<camera id="0"', '<camera id="0" component_id="4"'))
    after = adopted(make_job, tmp_path / "again", path, photos).images[1].cam_from_world()
    np.testing.assert_allclose(after.matrix(), before.matrix(), atol=1e-12)


def test_each_frame_may_have_a_lens_of_its_own(make_job, tmp_path, photos):
    path = transforms(tmp_path)[0]
    document = json.loads(path.read_text())
    document["frames"] += [document["frames"][0] | {"file_path": "b.png", "fl_x": 90, "fl_y": 90}]
    model = adopted(make_job, tmp_path, written(path, document), photos)
    focal = {image.name: model.cameras[image.camera_id].params[0] for image in registered(model)}
    assert focal == {"a.png": FX, "b.png": 90}


def test_photos_of_another_size_scale_the_camera(make_job, tmp_path, photos):
    write_png_srgb8(photos / "a.png", np.full((2 * HEIGHT, 2 * WIDTH, 3), 0.5, np.float32))
    model = adopted(make_job, tmp_path, transforms(tmp_path)[0], photos)
    np.testing.assert_allclose(model.cameras[1].params[:4], [2 * FX, 2 * FY, 2 * CX, 2 * CY])


@pytest.mark.parametrize("length", range(1, 24))
def test_names_may_have_any_letters(length, tmp_path):
    path = middlebury(tmp_path)[0]
    path.write_text(path.read_text().replace("1\na.png", "ü" * length + ".png"), encoding="utf-8")
    assert read_posed_photos(path, [], None, 0.0)[0].path == "ü" * length + ".png"


def test_the_guide_s_example_of_plain_matrices_is_one_camera_twice(tmp_path):
    guide = (Path(__file__).parent.parent / "docs/guide.md").read_text(encoding="utf-8")
    (tmp_path / "m.txt").write_text("2 " + guide.partition("```\n2 ")[2].partition("```")[0])
    a, b = read_posed_photos(tmp_path / "m.txt", [], None, 0.0)
    np.testing.assert_allclose(a.cam_from_world, b.cam_from_world, atol=1e-9)
    np.testing.assert_allclose(a.lens.parameters((1, 1)), b.lens.parameters((1, 1)))


def test_a_bundle_without_a_list_is_of_all_photos_in_order(make_job, tmp_path, photos):
    path = bundler(tmp_path)[0]
    posed = read_posed_photos(path, ["a.png", "b.png"], None, 0.0)
    assert [one.path for one in posed] == ["a.png"]
    with pytest.raises(UserError, match=r"has 2 cameras, but there are 3 photos; expected a list of them"):
        read_posed_photos(path, ["a.png", "b.png", "c.png"], None, 0.0)


def test_cameras_out_and_in_again_are_the_same(tmp_path):
    """`transforms.json` as `export` writes it, read: to 1e-9 px and model units."""
    pose = np.column_stack([rotation(), -rotation() @ CENTRE])
    K = np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1]])
    cameras = [Camera("sub/a{x}", WIDTH, HEIGHT, K, pose), Camera("sub/b", 60, 45, K / [[2], [2], [1]], pose)]
    write_transforms(tmp_path / "transforms.json", cameras, "dense/images/{name}.png", "mask/{name}.png")
    names = [f"{camera.name}.png" for camera in cameras]
    posed = read_posed_photos(tmp_path / "transforms.json", names, None, 0.0)
    found = photo_of_each_path([one.path for one in posed], names, tmp_path)
    read = cameras_of(model_of_posed_photos(posed, found, lambda photo: (1, 1), 0.0, tmp_path))
    for was, now in zip(cameras, read, strict=True):
        assert (was.name, was.width, was.height) == (now.name, now.width, now.height)
        np.testing.assert_allclose(now.intrinsics, was.intrinsics, atol=1e-9)
        np.testing.assert_allclose(now.cam_from_world, was.cam_from_world, atol=1e-9)


def test_photos_are_found_by_the_end_of_their_paths():
    photos = ["left/1.jpg", "right/1.jpg", "2.v2.png"]
    paths = ["/home/me/right/1.JPG", "D:\\shoot\\left\\1.tif", "./train/2.v2", "gone.png"]
    found = photo_of_each_path(paths, photos, Path("x"))
    assert found == {paths[0]: "right/1.jpg", paths[1]: "left/1.jpg", paths[2]: "2.v2.png"}
    with pytest.raises(UserError, match=r"'1\.jpg', which may be left/1\.jpg or right/1\.jpg"):
        photo_of_each_path(["1.jpg"], photos, Path("x"))
    with pytest.raises(UserError, match=r"which are both left/1\.jpg"):
        photo_of_each_path(["left/1", "a/left/1.png"], photos, Path("x"))


def test_photos_are_found_however_their_accents_are_spelled():
    composed, decomposed = (unicodedata.normalize(form, "château/façade.jpg") for form in ("NFC", "NFD"))
    for path, photo in ((composed, decomposed), (decomposed, composed)):
        assert photo_of_each_path([path], [photo], Path("x")) == {path: photo}


def test_poses_invert_and_flip_twice_to_themselves():
    pose = np.column_stack([rotation(), CENTRE])
    np.testing.assert_allclose(inverse(inverse(pose)), pose, atol=1e-15)
    np.testing.assert_array_equal(with_flipped_camera_axes(with_flipped_camera_axes(pose)), pose)
    np.testing.assert_allclose(nearest_rotation(7 * rotation()), rotation(), atol=1e-12)
    for wrong in (np.diag([1.0, 1, -1]), np.diag([1.0, 1, 2]), np.zeros((3, 3)), np.full((3, 3), np.nan)):
        with pytest.raises(ValueError, match="it "):
            nearest_rotation(wrong)


DAMAGE = {
    "no json": (transforms, "{", "[", "is of no camera|cannot be read|has \\d+ numbers"),
    "cut": (transforms, "]]", "]", "it is not JSON"),
    "no number": (transforms, '"fl_x": 100.0', '"fl_x": "wide"', "fl_x is 'wide', expected a number"),
    "no angle": (transforms, '"fl_x": 100.0', '"camera_angle_x": 1, "camera_angle_y": 0', "a camera_angle_y"),
    "infinite": (transforms, '"fl_x": 100.0', '"fl_x": 1e999', "fl_x is inf, expected a number"),
    "huge": (transforms, '"w": 120', '"w": 1e18', "an image has 1e\\+18 × 90 pixels"),
    "negative focal": (transforms, '"fl_x": 100.0', '"fl_x": -100.0', "a focal length of -100 px"),
    "mirrored": (transforms, "[0, 0, 0, 1]", "[0, 0, 0, 1], 5", "expected 4 × 4 numbers"),
    "panorama": (transforms, '"OPENCV"', '"EQUIRECTANGULAR"', "camera_model 'EQUIRECTANGULAR'; expected"),
    "no frames": (transforms, '"frames"', '"shots"', "is JSON of .*expected transforms.json"),
    "no name": (transforms, '"file_path"', '"path"', "has the file_path None"),
    "other photos": (transforms, "images/a.png", "images/z.png", "No photo in .*expected images/z.png"),
    "bundle cut": (bundler, "\n2 0\n", "\n2000000 0\n", "promises 2e\\+06 cameras"),
    "bundle short": (bundler, "0 0 0\n0 0 0\n", "", "ends after 1"),
    "no bundle": (bundler, "v0.3\n2 0\n", "v0.3\ntwo\n", "the number of cameras is 'two'"),
    "short line": (middlebury, " 42 ", " ", "has 20 numbers for a.png; expected 21"),
    "more lines": (middlebury, "1\n", "3\n", "promises 3 photos and has 1"),
    "no rotation": (middlebury, "a.png 100 0 63", "a.png 100 5000 63", "the eighth power, which move pixels"),
    "no centre": (meshroom, '"center"', '"centre"', "a center is None, expected 3 numbers"),
    "anamorphic": (meshroom, '"brown"', '"3deanamorphic4"', "of the type '3deanamorphic4'; expected pinhole"),
    "no version": (meshroom, '"version"', '"versions"', "the version is None"),
    "entities": (metashape, "<document", "<!DOCTYPE x [<!ENTITY a 'b'>]><document", "declares entities"),
    "no xml": (metashape, "</chunk>", "", "it is not XML"),
    "spherical": (metashape, 'id="0" type="frame"', 'id="0" type="spherical"', "type 'spherical'; expected"),
    "strange sensor": (metashape, 'sensor_id="0"', 'sensor_id="9"', "the sensor '9', which is not there"),
    "r^8": (metashape, "<k1>", "<k4>-900</k4><k1>", "a radial term of the eighth power"),
    "p3": (metashape, "<k1>", "<p1>.001</p1><p3>5</p3><k1>", "coefficients p3 and p4; expected p1 and p2"),
    "skew": (metashape, "<k1>", "<b2>3</b2><k1>", "has skew or"),
}


@pytest.mark.parametrize("case", DAMAGE)
def test_damage_is_a_sentence(case, make_job, tmp_path, photos):
    door, before, after, says = DAMAGE[case]
    path = door(tmp_path)[0]
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after, 1))
    with pytest.raises(UserError, match=says):
        adopted(make_job, tmp_path, path, photos)


@pytest.mark.parametrize(
    "data", [b"", b"\xff\xfe\0", b"[" * 100_000, b"{" * 100_000, b"<a>" * 100_000, bytes(99)]
)
def test_what_is_no_file_of_cameras_is_a_sentence(data, make_job, tmp_path, photos):
    path = tmp_path / "cameras"
    path.write_bytes(data)
    with pytest.raises(UserError):
        adopted(make_job, tmp_path, path, photos)


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.__name__)
def test_a_file_cut_anywhere_or_with_other_bytes_is_a_sentence_or_a_model(door, tmp_path):
    """Never a traceback."""
    path = door(tmp_path)[0]
    path = path / "a.txt" if path.is_dir() else path
    whole, rng = path.read_bytes(), np.random.default_rng(1)
    target = path.parent if door is projections else path
    for trial in range(60):
        data = bytearray(whole[: rng.integers(len(whole))] if trial % 2 else whole)
        for place in rng.integers(0, max(len(data), 1), 4 if len(data) else 0):
            data[place] = rng.integers(256)
        path.write_bytes(bytes(data))
        try:
            posed = read_posed_photos(target, ["a.png", "b.png"], None, 0.0)
            found = photo_of_each_path([one.path for one in posed], ["a.png", "b.png"], path)
            model_of_posed_photos(posed, found, lambda photo: (WIDTH, HEIGHT), 0.1, path)
        except UserError:
            pass
