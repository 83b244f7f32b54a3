"""What estimated geometry costs: the truth goes through the lens that was found, the mesh to its cameras."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from benchmarks.estimated_geometry import Scene, in_frame_of, judged
from stages.formats.colmap.model import pinhole_model, write_model
from stages.formats.images.exr import write_exr
from stages.formats.meshes.triangle_meshes import Surface, write_mesh
from stages.scene.cameras import Camera

WIDTH, HEIGHT, FOCAL_PX = 64, 48, 60.0
NAMES = ("000", "001", "002")


def camera(name: str, pose: np.ndarray) -> Camera:
    K = np.array([[FOCAL_PX, 0, WIDTH / 2], [0, FOCAL_PX, HEIGHT / 2], [0, 0, 1]])
    return Camera(name, WIDTH, HEIGHT, K, pose)


def paint(rays: np.ndarray) -> np.ndarray:
    """Albedo by direction (n, 2): soft stripes on a disc, 0 beside it."""
    stripes = 0.5 + 0.3 * np.sin(12 * rays[..., :1] + 7 * rays[..., 1:] + np.arange(3))
    return np.where(np.hypot(*rays.T).T[..., None] < 0.35, stripes, 0)


def pixel_centres() -> np.ndarray:
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    return np.column_stack([x.ravel(), y.ravel()])


@pytest.fixture
def run_of_a_bent_lens(tmp_path) -> tuple[Scene, Path, Path]:
    """Three views whose photos a radial lens took, and the albedo of its pinhole views, exact."""
    lens = pycolmap.Camera(
        model="SIMPLE_RADIAL",
        width=WIDTH,
        height=HEIGHT,
        params=[FOCAL_PX, WIDTH / 2, HEIGHT / 2, 0.4],
        camera_id=1,
    )
    photo = paint(lens.cam_from_img(pixel_centres())).reshape(HEIGHT, WIDTH, 3)
    pinhole = paint((pixel_centres() - [WIDTH / 2, HEIGHT / 2]) / FOCAL_PX).reshape(HEIGHT, WIDTH, 3)
    cameras = [camera(name, np.eye(4)[:3] + 0.1 * n * np.eye(4)[:3, [3]]) for n, name in enumerate(NAMES)]
    workspace = tmp_path / "run"
    undistorted = workspace / "cache" / "undistort" / "0"
    write_model(pinhole_model(cameras), undistorted / "workspace" / "sparse")
    (undistorted / "record.json").write_text("{}", encoding="utf-8")
    bent = pinhole_model(cameras)
    for one in bent.cameras.values():
        one.model = pycolmap.CameraModelId.SIMPLE_RADIAL
        one.params = lens.params
    write_model(bent, tmp_path / "bent")
    for name in NAMES:
        write_exr(workspace / "output" / "albedo" / f"{name}.exr", (2 * pinhole).astype(np.float32))
    return Scene("bent", tmp_path, tmp_path / "bent", tmp_path, lambda _: photo), tmp_path / "bent", workspace


def test_exact_albedo_has_no_error_through_the_lens_of_its_photos(run_of_a_bent_lens):
    scene, lenses, workspace = run_of_a_bent_lens
    exact = judged(scene, lenses, workspace)
    assert max(exact.si_rmse) < 0.006  # of linear interpolation
    assert exact.surface_covered == 1 and exact.background_in_masks < 0.02
    without = judged(scene, workspace / "cache" / "undistort" / "0" / "workspace" / "sparse", workspace)
    assert max(without.si_rmse) > 5 * max(exact.si_rmse)


def test_the_mesh_moves_with_the_cameras(tmp_path):
    rng = np.random.default_rng(0)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    centres = rng.normal(size=(3, 3))

    def model_of(places: np.ndarray, folder: Path) -> Path:
        poses = [np.column_stack([np.eye(3), -place]) for place in places]
        cameras = [camera(name, pose) for name, pose in zip(NAMES, poses, strict=True)]
        write_model(pinhole_model(cameras), folder)
        return folder

    mesh = Surface(rng.normal(size=(4, 3)), np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    write_mesh(tmp_path / "mesh.ply", mesh)
    true = model_of(centres, tmp_path / "true")
    found = model_of(2 * centres @ rotation.T + 5, tmp_path / "found")
    scene = Scene("moved", tmp_path, true, tmp_path / "mesh.ply", lambda _: np.zeros(()))
    moved = in_frame_of(scene, found)
    assert np.allclose(moved.vertices, 2 * mesh.vertices @ rotation.T + 5, atol=1e-9)
    assert np.array_equal(moved.faces, mesh.faces)
