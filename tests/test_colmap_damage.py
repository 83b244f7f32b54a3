"""COLMAP models that were cut, overwritten or made up: what is read is what COLMAP reads, or a sentence."""

from __future__ import annotations

import shutil
import struct

import numpy as np
import pycolmap
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline import UserError
from stages.formats.colmap.binary_files import check_binary_files
from stages.formats.colmap.model import read_model, write_model
from tests.short_writes import no_file_longer_than
from tests.test_colmap_model import distorted_model

FILES = ("cameras", "images", "points3D", "rigs", "frames")
MANY = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A sound model in binary."""
    folder = tmp_path_factory.mktemp("whole")
    write_model(distorted_model(), folder)
    return folder


def copied(whole, folder, **changed: bytes):
    """The model with other bytes in some of its files."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(whole, folder)
    for name, data in changed.items():
        (folder / f"{name}.bin").write_bytes(data)
    return folder


def content_of(model: pycolmap.Reconstruction) -> list:
    cameras = [(i, c.model_name, c.width, c.height, *c.params) for i, c in sorted(model.cameras.items())]
    images = [
        (i, image.name, image.camera_id, image.cam_from_world().matrix().tolist(), len(image.points2D))
        for i, image in sorted(model.images.items())
    ]
    points = [(i, *p.xyz, p.track.length()) for i, p in sorted(model.points3D.items())]
    return [cameras, images, points]


def test_a_sound_model_is_what_was_written(whole):
    assert content_of(read_model(whole)) == content_of(distorted_model())
    counts = check_binary_files(whole)
    assert counts == {"cameras": 1, "images": 4, "points3D": 40, "rigs": 1, "frames": 4}


@pytest.mark.parametrize("name", FILES)
def test_every_cut_of_every_file_is_refused(whole, tmp_path, name):
    """Of cameras.bin pycolmap takes any part, and makes up the rest."""
    data = (whole / f"{name}.bin").read_bytes()
    for end in sorted({*range(0, len(data), max(1, len(data) // 60)), *range(len(data) - 30, len(data))}):
        if 0 <= end < len(data):
            folder = copied(whole, tmp_path / "m", **{name: data[:end]})
            with pytest.raises(UserError, match=rf"{name}\.bin promises .* was cut off or damaged"):
                read_model(folder)


@pytest.mark.parametrize("name", FILES)
def test_more_than_is_promised_is_refused(whole, tmp_path, name):
    data = (whole / f"{name}.bin").read_bytes()
    with pytest.raises(UserError, match=r"goes on for 3 bytes"):
        read_model(copied(whole, tmp_path / "m", **{name: data + b"abc"}))


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("count", [2**40, 2**63, 1000])
def test_impossible_counts_are_refused_at_once(whole, tmp_path, name, count):
    data = struct.pack("<Q", count) + (whole / f"{name}.bin").read_bytes()[8:]
    with pytest.raises(UserError, match=rf"promises {count} {name}"):
        read_model(copied(whole, tmp_path / "m", **{name: data}))


@MANY
@given(name=st.sampled_from(FILES), place=st.floats(0, 1, exclude_max=True), byte=st.integers(0, 255))
def test_a_byte_changed_is_a_whole_model_or_a_sentence(whole, tmp_path, name, place, byte):
    data = bytearray((whole / f"{name}.bin").read_bytes())
    data[int(place * len(data))] = byte
    folder = copied(whole, tmp_path / "m", **{name: bytes(data)})
    try:
        model = read_model(folder)
    except UserError:
        return
    counts = check_binary_files(folder)
    assert (len(model.cameras), len(model.images), len(model.points3D)) == (
        counts["cameras"],
        counts["images"],
        counts["points3D"],
    )
    for image in model.images.values():
        assert np.isfinite(image.cam_from_world().matrix()).all()


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
def test_a_text_model_with_fewer_lines_than_its_comment_says_is_refused(tmp_path, name):
    model = distorted_model(names=[f"photo_{index}.jpg" for index in range(4)])
    model.write_text(tmp_path)
    lines = (tmp_path / f"{name}.txt").read_text().splitlines(keepends=True)
    if name == "images":  # whose last is gone, and nothing else speaks of it
        head = [line for line in lines if line.startswith("#")]
        poses = [line for line in lines[len(head) :] if ".jpg" in line]
        lines = [*head, *(part for pose in poses[:-1] for part in (pose, "\n"))]
        (tmp_path / "points3D.txt").unlink()
    elif name == "cameras":  # another one that nobody uses is gone
        lines[2] = lines[2].replace("cameras: 1", "cameras: 2")
    else:
        lines = lines[:-1]
    (tmp_path / f"{name}.txt").write_text("".join(lines))
    for left in ("rigs.txt", "frames.txt"):
        (tmp_path / left).unlink(missing_ok=True)
    with pytest.raises(UserError, match=f"promises .* {name} and holds .* mend the comment"):
        read_model(tmp_path)


def test_more_than_a_comment_promises_is_no_cut(tmp_path):
    """As in a model that somebody added to by hand, under a head that was copied."""
    distorted_model(names=[f"photo_{index}.jpg" for index in range(4)]).write_text(tmp_path)
    text = (tmp_path / "images.txt").read_text()
    (tmp_path / "images.txt").write_text(text.replace("images: 4", "images: 2"))
    assert len(read_model(tmp_path).images) == 4


def test_a_last_line_of_points_that_is_missing_is_a_sentence(tmp_path):
    model = distorted_model(names=[f"photo_{index}.jpg" for index in range(4)])
    model.write_text(tmp_path)
    for left in ("rigs.txt", "frames.txt"):
        (tmp_path / left).unlink()
    lines = [line for line in (tmp_path / "images.txt").read_text().splitlines() if not line.startswith("#")]
    (tmp_path / "images.txt").write_text("\n".join(lines[:-1]))
    with pytest.raises(UserError, match="COLMAP model in"):
        read_model(tmp_path)


def test_a_model_of_posed_and_other_images_is_written(tmp_path):
    model = distorted_model()
    frame = model.images[min(model.images)].frame_id
    model.deregister_frame(frame)
    write_model(model, tmp_path / "m")
    assert len(read_model(tmp_path / "m").images) == 3


@pytest.mark.parametrize(
    ("params", "sentence"),
    [
        ([100.0, -100, 61, 44, 0, 0, 0, 0], "a focal length of -100 px"),
        ([100.0, 100, 1254, 44, 0, 0, 0, 0], "a principal point at 1254, 44 px"),
        ([1e-3, 1e-3, 61, 44, 0, 0, 0, 0], "a focal length of 0.001 px"),
        ([1e8, 1e8, 61, 44, 0, 0, 0, 0], r"a focal length of 1e\+08 px"),
        ([100.0, 100, 61, 44, 1e6, 0, 0, 0], "its lens draws the image out"),
        ([400.0, 400, 61, 44, -50, 0, 0, 0], "its lens can be undone over"),
        ([100.0, np.inf, 61, 44, 0, 0, 0, 0], "they are not all finite"),
    ],
)
def test_impossible_cameras_are_refused_by_what_is_wrong(tmp_path, params, sentence):
    model = distorted_model()
    model.cameras[7].model = pycolmap.CameraModelId.OPENCV
    model.cameras[7].params = params
    model.write_binary(tmp_path)
    with pytest.raises(UserError, match=f"impossible parameters: {sentence}"):
        read_model(tmp_path)


@pytest.mark.parametrize(
    ("model_name", "params"),
    [
        ("SIMPLE_RADIAL", [100.0, 60, 45, -0.3]),
        ("OPENCV", [90.0, 91, 66, 40, -0.25, 0.08, 1e-3, -1e-3]),
        ("OPENCV_FISHEYE", [50.0, 50, 60, 45, 0.02, -0.01, 0, 0]),
        ("PINHOLE", [2000.0, 2000, 60, 45]),
        ("PINHOLE", [100.0, 100, -30, 45]),  # a crop
        ("PINHOLE", [900.0, 900, -1500, 45]),  # a small one, far from the middle of a wide photo
        ("EQUIRECTANGULAR", [120.0, 90]),
        ("SIMPLE_RADIAL", [53.0, 60, 45, -0.35]),
    ],
)
def test_strong_lenses_long_lenses_and_crops_are_cameras(tmp_path, model_name, params):
    model = distorted_model()
    model.cameras[7].model = getattr(pycolmap.CameraModelId, model_name)
    model.cameras[7].params = params
    model.write_binary(tmp_path)
    assert len(read_model(tmp_path).images) == 4


@pytest.mark.parametrize("with_frames", [True, False])
def test_a_pose_without_a_rotation_is_refused(whole, tmp_path, with_frames):
    nothing = struct.pack("<4d", 0, 0, 0, 0)
    images = bytearray((whole / "images.bin").read_bytes())
    images[12:44] = nothing
    frames = bytearray((whole / "frames.bin").read_bytes())
    frames[16:48] = nothing
    folder = copied(whole, tmp_path / "m", images=bytes(images), frames=bytes(frames))
    if not with_frames:
        (folder / "frames.bin").unlink()
        (folder / "rigs.bin").unlink()
    with pytest.raises(UserError, match="a pose that is not one"):
        read_model(folder)


@pytest.mark.parametrize("name", FILES)
def test_a_model_that_the_disk_cuts_is_no_model(whole, tmp_path, name):
    size = (whole / f"{name}.bin").stat().st_size
    model = read_model(whole)
    with no_file_longer_than(size - 1), pytest.raises(OSError, match="cut short"):
        write_model(model, tmp_path / "m")
