"""`--cameras` as its users meet it: from a file of another program to the albedo, and on real files."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from stages.cli import main
from stages.formats.cameras.transforms_json import write_transforms
from stages.formats.colmap.model import cameras_of, read_model, registered
from stages.formats.images.exr import read_exr
from stages.formats.images.masks import read_mask
from stages.formats.images.photos import read_photo
from stages.formats.meshes.mesh_files import read_mesh_file
from stages.scene.cameras import Camera, project

SAMPLE = Path(__file__).parent.parent / "sample_data"
LINEAR = SAMPLE / "linear"
WITH_MESH = ["--mesh", SAMPLE / "truth/mesh.ply"]
SMALL = ("undistort.max_size_px=96", "transfer.max_vertices=1500", "transfer.sky_directions=64")
QUICK = [word for setting in SMALL for word in ("--set", setting)]


def unshade(capsys, *words: str | Path) -> tuple[int, str]:
    """Exit code and error output, in one line."""
    code = main([str(word) for word in words])
    return code, " ".join(capsys.readouterr().err.split())


@pytest.fixture(scope="module")
def from_transforms(tmp_path_factory) -> Path:
    """The workspace of a run with cameras from `transforms.json`, to the end."""
    folder = tmp_path_factory.mktemp("transforms")
    write_transforms(
        folder / "t.json", cameras_of(read_model(LINEAR / "sparse")), "images/{name}.exr", "{name}"
    )
    words = ["run", "--cameras", folder / "t.json", "--images", LINEAR / "images", *WITH_MESH, *QUICK]
    assert main([str(word) for word in [*words, "--workspace", folder / "w"]]) == 0
    return folder / "w"


@pytest.fixture(scope="module")
def plain(tmp_path_factory) -> Path:
    """The workspace of a run with the cameras of COLMAP, to the end."""
    workspace = tmp_path_factory.mktemp("plain") / "w"
    words = ["run", "--colmap", LINEAR, *WITH_MESH, *QUICK, "--workspace", workspace]
    assert main([str(word) for word in words]) == 0
    return workspace


def assert_same_albedo(plain: Path, other: Path) -> None:
    """Both workspaces have the albedo of the same views, but for rounding of the cameras."""
    paths = sorted((plain / "output/albedo").glob("*.exr"))
    assert len(paths) == 4
    for path in paths:
        mask = read_mask(plain / "output/mask" / f"{path.stem}.png")
        one, two = (read_exr(of / "output/albedo" / path.name)[mask] for of in (plain, other))
        assert np.abs(one - two).mean() < 1e-3 * one.mean()


def test_cameras_of_transforms_json_give_the_albedo_of_the_same_cameras_of_colmap(from_transforms, plain):
    assert_same_albedo(plain, from_transforms)


def as_bundler(folder: Path, cameras: list[Camera]) -> Path:
    """y up, away from the viewer, from the middle of the image: `list.txt` has the names."""
    rows = []
    for camera in cameras:
        upright = np.diag([1.0, -1, -1]) @ camera.cam_from_world
        rows += [[camera.focal_px, 0, 0], *upright[:, :3], upright[:, 3]]
    numbers = "\n".join(" ".join(f"{one:.17g}" for one in row) for row in rows)
    (folder / "list.txt").write_text("".join(f"./{camera.name}.exr\n" for camera in cameras))
    path = folder / "bundle.out"
    path.write_text(f"# Bundle file v0.3\n{len(cameras)} 0\n{numbers}\n")
    return path


def as_matrices(folder: Path, cameras: list[Camera]) -> Path:
    """Middlebury's lines; the first pixel's centre is 0, 0."""
    lines = [str(len(cameras))]
    for camera in cameras:
        K = camera.intrinsics - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
        pose = camera.cam_from_world
        values = (*K.ravel(), *pose[:, :3].ravel(), *pose[:, 3])
        lines.append(f"{camera.name}.exr " + " ".join(f"{one:.17g}" for one in values))
    path = folder / "sample_par.txt"
    path.write_text("\n".join(lines) + "\n")
    return path


def as_meshroom(folder: Path, cameras: list[Camera]) -> Path:
    """Every number as text; the focal length in millimetres, rotations by columns, places of the cameras."""
    views, poses = [], []
    for number, camera in enumerate(cameras):
        own = {"viewId": str(number), "poseId": str(number), "intrinsicId": "7"}
        views.append(own | {"path": f"C:\\photos\\{camera.name}.exr"})
        rotation = camera.cam_from_world[:, :3]
        place = {"rotation": [repr(float(one)) for one in rotation.T.ravel()]}
        place["center"] = [repr(float(one)) for one in -rotation.T @ camera.cam_from_world[:, 3]]
        poses.append({"poseId": str(number), "pose": {"transform": place}})
    camera = cameras[0]
    lens = {"intrinsicId": "7", "width": str(camera.width), "height": str(camera.height), "type": "pinhole"}
    lens |= {"sensorWidth": "36", "focalLength": repr(camera.focal_px * 36 / camera.width)}
    lens |= {"pixelRatio": "1", "principalPoint": ["0", "0"], "distortionParams": ""}
    document = {"version": ["1", "2", "6"], "views": views, "intrinsics": [lens], "poses": poses}
    path = folder / "cameras.sfm"
    path.write_text(json.dumps(document))
    return path


def as_metashape(folder: Path, cameras: list[Camera]) -> Path:
    """World from camera, by rows; the principal point from the middle of the image."""
    placed = []
    for number, camera in enumerate(cameras):
        world_from_cam = np.linalg.inv(np.vstack([camera.cam_from_world, [0, 0, 0, 1]]))
        listed = " ".join(repr(float(one)) for one in world_from_cam.ravel())
        words = f'id="{number}" sensor_id="0" label="{camera.name}"'
        placed.append(f"<camera {words}><transform>{listed}</transform></camera>")
    camera = cameras[0]
    size = f'<resolution width="{camera.width}" height="{camera.height}"/>'
    path = folder / "cameras.xml"
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?><document version="1.5.0"><chunk label="Chunk 1">'
        f'<sensors><sensor id="0" type="frame">{size}<calibration type="frame" class="adjusted">{size}'
        f"<f>{camera.focal_px!r}</f></calibration></sensor></sensors>"
        f"<cameras>{''.join(placed)}</cameras></chunk></document>"
    )
    return path


@pytest.mark.slow
@pytest.mark.parametrize("written", [as_bundler, as_matrices, as_meshroom, as_metashape])
def test_cameras_of_any_program_give_the_albedo_of_the_same_cameras_of_colmap(
    written, plain, tmp_path, capsys
):
    path = written(tmp_path, cameras_of(read_model(LINEAR / "sparse")))
    words = ["run", "--cameras", path, "--images", LINEAR / "images", *WITH_MESH, *QUICK]
    code, said = unshade(capsys, *words, "--workspace", tmp_path / "w")
    assert code == 0, said
    assert_same_albedo(plain, tmp_path / "w")


def test_transforms_json_that_a_run_wrote_gives_the_cameras_that_it_had(from_transforms, tmp_path, capsys):
    output = from_transforms / "output"
    frames = json.loads((output / "transforms.json").read_text())["frames"]
    assert all((output / frame[key]).is_file() for frame in frames for key in ("file_path", "mask_path"))
    words = ["run", "--cameras", output / "transforms.json", "--images", output / "dense/images"]
    assert unshade(capsys, *words, "--workspace", tmp_path / "w", "--to", "adopt_cameras")[0] == 0
    (model,) = (tmp_path / "w/cache/adopt_cameras").glob("*/model")
    read, written = cameras_of(read_model(model)), json.loads((output / "cameras.json").read_text())
    for camera, was in zip(read, written, strict=True):
        assert (camera.name, camera.width, camera.height) == (was["name"], was["width"], was["height"])
        np.testing.assert_allclose(camera.intrinsics, was["intrinsics"], atol=1e-6)
        np.testing.assert_allclose(camera.cam_from_world, was["cam_from_world"], atol=1e-6)


def test_photos_and_lists_beside_the_cameras_are_found(tmp_path, capsys):
    """Bundler's own folders: bundle/bundle.out, list.txt above; another list is other cameras."""
    shutil.copytree(LINEAR / "images", tmp_path / "images")
    (tmp_path / "bundle").mkdir()
    rows = "312 0 0\n1 0 0\n0 1 0\n0 0 1\n0 0 -3\n" + "0 0 0\n" * 5
    (tmp_path / "bundle/bundle.out").write_text(f"# Bundle file v0.3\n2 0\n{rows}")
    words = ["run", "--cameras", tmp_path / "bundle/bundle.out", "--images", tmp_path / "images"]
    words += ["--workspace", tmp_path / "w", "--to", "adopt_cameras", "--json"]
    for name in ("003", "009"):
        (tmp_path / "list.txt").write_text(f"./{name}.exr 0 312\n./001.exr\n")
        assert unshade(capsys, *words)[0] == 0
    models = (tmp_path / "w/cache/adopt_cameras").glob("*/model")
    assert sorted(image.name for model in models for image in registered(read_model(model))) == [
        "003.exr",
        "009.exr",
    ]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--colmap", "transforms.json"], "A file of cameras is given by `--cameras transforms.json`."),
        (
            ["--colmap", "."],
            "holds transforms.json and no COLMAP model; cameras of other programs are given by",
        ),
        (["--cameras", "transforms.json", "--colmap", str(LINEAR)], "--colmap and --cameras were given"),
        (["--cameras", "nowhere.json"], "does not exist; expected a file or a folder"),
        (["--mesh", "transforms.json"], "--mesh was given without --colmap or --cameras"),
        (["--cameras", "transforms.json"], "is JSON of []; expected transforms.json, Bundler's"),
    ],
)
def test_a_mistake_gets_a_sentence(words, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("transforms.json").write_text("{}")
    code, said = unshade(capsys, "run", *words, "--images", LINEAR / "images", "--workspace", "../w")
    assert code == 2
    assert says in said


def test_a_bundle_of_bundler_shows_its_points_where_it_saw_them(data_folder, tmp_path, capsys):
    """Kermit, nine of eleven photos placed: its own observations are the truth."""
    kermit = data_folder / "photos-bundler-kermit"
    bundle = kermit / "results.example/bundle.out"
    words = ["run", "--cameras", bundle, "--images", kermit, "--workspace", tmp_path / "w"]
    assert unshade(capsys, *words, "--to", "adopt_cameras")[0] == 0
    (folder,) = (tmp_path / "w/cache/adopt_cameras").glob("*/model")
    model = read_model(folder)
    images = {image.name: image for image in registered(model)}
    assert len(images) == 9
    lines = bundle.read_text().splitlines()[2 + 5 * 11 :]
    off_px = []
    for position, seen_by in zip(lines[::3], lines[2::3], strict=True):
        x_in_world = np.array(position.split(), float)
        for camera_index, _, x, y in np.array(seen_by.split()[1:], float).reshape(-1, 4):
            image = images[f"kermit{int(camera_index):03}.jpg"]
            camera = model.cameras[image.camera_id]
            xy = camera.img_from_cam(image.cam_from_world() * x_in_world)
            off_px.append(np.hypot(*(xy - [camera.width / 2 + x, camera.height / 2 - y])))
    assert len(off_px) > 1000
    assert np.median(off_px) < 0.5


def test_matrices_of_middlebury_put_the_object_where_the_photos_show_it(data_folder, tmp_path, capsys):
    temple = data_folder / "photos-middlebury-temple"
    words = ["run", "--cameras", temple / "templeSR_par.txt", "--images", temple]
    assert unshade(capsys, *words, "--workspace", tmp_path / "w", "--to", "undistort")[0] == 0
    (folder,) = (tmp_path / "w/cache/undistort").glob("*/workspace/sparse")
    hull = read_mesh_file(temple / "visual_hull.ply").vertices
    for camera in cameras_of(read_model(folder)):
        bright = np.argwhere(read_photo(temple / f"{camera.name}.png").max(axis=2) > 0.05)[:, ::-1]
        shown, _ = project(camera, np.asarray(hull, float))
        inside = ((bright >= shown.min(axis=0)) & (bright <= shown.max(axis=0))).all(axis=1)
        assert inside.mean() > 0.95, camera.name
        assert np.abs(bright.mean(axis=0) - (shown.min(axis=0) + shown.max(axis=0)) / 2).max() < 60
