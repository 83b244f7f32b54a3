"""COLMAP 4's rigs and frames: two cameras on a bar, written by pycolmap, read through `--colmap`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from pipeline import UserError
from stages.cli import main
from stages.formats.colmap.model import cameras_of, read_model
from stages.formats.images.photos import write_png_srgb8
from stages.scene.cameras import Camera

RIGHT_FROM_LEFT = pycolmap.Rigid3d(
    pycolmap.Rotation3d(np.array([0.02, -0.1, 0.03])), np.array([-0.4, 0.01, 0.02])
)
LENSES = {1: [100.0, 100, 60, 45], 2: [90.0, 92, 50, 31]}
SIZES = {1: (120, 90), 2: (100, 60)}


def left_from_world(moment: int) -> pycolmap.Rigid3d:
    return pycolmap.Rigid3d(
        pycolmap.Rotation3d(np.array([0.1 * moment, 0.2, -0.1])), np.array([moment, 0.5, 2.0])
    )


def model_of_a_rig(
    right_from_left: pycolmap.Rigid3d | None = RIGHT_FROM_LEFT, moments: int = 3
) -> pycolmap.Reconstruction:
    """Two PINHOLE cameras of different sizes on one rig, at some moments."""
    model, rig = pycolmap.Reconstruction(), pycolmap.Rig(rig_id=1)
    sensors = {number: pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number) for number in LENSES}
    for number, params in LENSES.items():
        width, height = SIZES[number]
        model.add_camera(
            pycolmap.Camera(camera_id=number, model="PINHOLE", width=width, height=height, params=params)
        )
    rig.add_ref_sensor(sensors[1])
    rig.add_sensor(sensors[2], right_from_left)
    model.add_rig(rig)
    for moment in range(moments):
        frame = pycolmap.Frame(frame_id=moment + 1, rig_id=1, rig_from_world=left_from_world(moment))
        images = {number: 10 * moment + number for number in LENSES}
        for number, image_id in images.items():
            frame.add_data_id(pycolmap.data_t(sensors[number], image_id))
        model.add_frame(frame)
        for number, image_id in images.items():
            name = f"{'left' if number == 1 else 'right'}/{moment}.png"
            model.add_image(
                pycolmap.Image(name=name, camera_id=number, image_id=image_id, frame_id=moment + 1)
            )
        model.register_frame(moment + 1)
    return model


def written(model: pycolmap.Reconstruction, folder: Path, text: bool) -> Path:
    folder.mkdir(parents=True)
    (model.write_text if text else model.write_binary)(folder)
    return folder


def expected_pose(name: str) -> np.ndarray:
    """cam_from_world by hand: right from left times left from world."""
    side, moment = name.split("/")
    one = np.vstack([left_from_world(int(moment)).matrix(), [0, 0, 0, 1]])
    return (RIGHT_FROM_LEFT.matrix() if side == "right" else np.eye(4)[:3]) @ one


def expect_poses(cameras: list[Camera]) -> None:
    assert [camera.name for camera in cameras] == [
        f"{side}/{i}" for side in ("left", "right") for i in range(3)
    ]
    for camera in cameras:
        number = 2 if camera.name.startswith("right") else 1
        assert (camera.width, camera.height) == SIZES[number]
        np.testing.assert_allclose(camera.cam_from_world, expected_pose(camera.name), atol=1e-12)
        np.testing.assert_allclose(camera.intrinsics[[0, 1, 0, 1], [0, 1, 2, 2]], LENSES[number])


@pytest.mark.parametrize("text", [False, True])
def test_images_of_a_rig_stand_where_rig_and_frame_put_them(text, tmp_path):
    expect_poses(cameras_of(read_model(written(model_of_a_rig(), tmp_path / "m", text))))


def test_a_rig_reaches_the_undistorted_workspace(tmp_path):
    """The command line, from rigs.bin and frames.bin to the pinhole cameras that all later stages see."""
    written(model_of_a_rig(), tmp_path / "colmap/sparse/0", text=False)
    assert (tmp_path / "colmap/sparse/0/rigs.bin").is_file()
    for number, side in ((1, "left"), (2, "right")):
        width, height = SIZES[number]
        for moment in range(3):
            grey = np.random.default_rng(moment).uniform(size=(height, width, 3)).astype(np.float32)
            write_png_srgb8(tmp_path / f"photos/{side}/{moment}.png", grey)
    words = ["run", "--colmap", tmp_path / "colmap", "--images", tmp_path / "photos", "--to", "undistort"]
    assert main([str(word) for word in [*words, "--workspace", tmp_path / "w"]]) == 0
    (workspace,) = (tmp_path / "w/cache/undistort").glob("*/workspace")
    expect_poses(cameras_of(read_model(workspace / "sparse")))


def test_a_rig_that_was_cut_is_a_sentence(tmp_path):
    folder = written(model_of_a_rig(), tmp_path / "m", text=False)
    rigs = (folder / "rigs.bin").read_bytes()
    (folder / "rigs.bin").write_bytes(rigs[:-8])
    with pytest.raises(UserError, match=r"rigs\.bin promises 1 rigs and ends before them"):
        read_model(folder)


def test_a_rig_that_is_not_calibrated_is_a_sentence(tmp_path):
    """rigs.bin: a count, two numbers and two sensors of 8 bytes each, whether there is a pose, the pose."""
    folder = written(model_of_a_rig(), tmp_path / "m", text=False)
    rigs = (folder / "rigs.bin").read_bytes()
    (folder / "rigs.bin").write_bytes(rigs[:32] + b"\0" + rigs[33 + 56 :])
    with pytest.raises(UserError, match="right/0.png .* without a pose in its rig"):
        read_model(folder)
