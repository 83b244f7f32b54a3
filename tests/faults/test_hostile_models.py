"""COLMAP models that were damaged or made up: a sentence, or a counted exclusion; nothing outside."""

from __future__ import annotations

import json
import os
import shutil
import stat
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from tests.faults.command_lines import Answer, answers_of, expect_refusal, obey
from tests.faults.program import LINEAR

WHOLE = {path.stem: path.read_bytes() for path in (LINEAR / "sparse").glob("*.bin")}
FIRST = b"001.exr\0"
LEADS_OUT, UNSHOWN, TOO_LONG = "leads out of the image folder", "cannot be shown", "longer than results"
CUT, NO_POSE, IMPOSSIBLE = "cut off or damaged", "a pose that is not one", "impossible parameters"
NOT_READ, NO_FILE = "cannot be read", "expected a file"

NAMES = {
    b"../../x.exr": LEADS_OUT,
    b"/etc/passwd": LEADS_OUT,
    b"a/../b.exr": LEADS_OUT,
    b"..": LEADS_OUT,
    b".": LEADS_OUT,
    b"": LEADS_OUT,
    b"c:x.exr": LEADS_OUT,
    b"a\\b.exr": LEADS_OUT,
    b".x.exr": "is hidden",
    b"a/.b/x.exr": "is hidden",
    b"a\nb.exr": UNSHOWN,
    b"\x1b[2J.exr": UNSHOWN,
    b"x" * 10000: TOO_LONG,
    b"x/" * 3000 + b"a.exr": TOO_LONG,
    b"\xff\xfe.exr": "names must be UTF-8",
    b"003.exr": "same name",
    b"a\0b": CUT,
}
FOCAL = [625.0, 625, 90, 120]
CAMERAS = {
    "no focal length": ([0.0, 0, 90, 120], {}),
    "negative focal length": ([-625.0, 625, 90, 120], {}),
    "NaN": ([np.nan, 625, 90, 120], {}),
    "infinite": ([np.inf, 625, 90, 120], {}),
    "tiny focal length": ([1e-300, 1e-300, 90, 120], {}),
    "huge focal length": ([1e300, 1e300, 90, 120], {}),
    "principal point far off": ([625.0, 625, 1e9, 1e9], {}),
    "no width": (FOCAL, {"width": 0}),
    "huge size": (FOCAL, {"width": 2**60, "height": 2**60}),
}
QUATERNION = struct.unpack("<4d", WHOLE["frames"][16:48])
POSES = {
    "no rotation": ([0.0] * 4, [0.0] * 3),
    "rotation of length 2": ([2 * one for one in QUATERNION], [0.0] * 3),
    "huge rotation": ([1e300 * one for one in QUATERNION], [0.0] * 3),
    "NaN rotation": ([np.nan] * 4, [0.0] * 3),
    "infinite place": (QUATERNION, [np.inf, 0, 0]),
    "place at 1e300": (QUATERNION, [1e300, 0, 0]),
    "place at 1e20": (QUATERNION, [1e20, 0, 0]),
}
TEXTS = {  # file, what is replaced by what, what is said
    "text: traversal": ("images", "001.exr", "../../x.exr", LEADS_OUT),
    "text: unknown camera": ("cameras", "PINHOLE", "NONSENSE", NOT_READ),
    "text: huge width": ("cameras", "PINHOLE ", "PINHOLE 99999999999999999999999", NOT_READ),
    "text: negative width": ("cameras", "PINHOLE ", "PINHOLE -", IMPOSSIBLE),
    "text: words for numbers": ("frames", "1 1 0", "1 1 nan", NOT_READ),
}
POINTS = {
    "text: points of no image": "1 2 3 4 5 6 7 8 9 10 11 12 99999999999\n",
    "text: short points": "1 2\n",
    "text: track beyond": "1 0 0 0 1 1 1 0 1 5 2 7\n",
}
KINDS: dict[str, Callable[[Path], None]] = {
    "named pipe": os.mkfifo,
    "device": lambda place: place.symlink_to("/dev/zero"),
    "socket": lambda place: os.mknod(place, stat.S_IFSOCK | 0o600),
    "loop": lambda place: place.symlink_to(place.name),
}
STORED = {"a mapping": b'{"a": [1]}', "nested": b"[" * 100_000, "no text": b"\xff"}
LEFT_OUT = {b"~/x.exr": "left out: ~/x.exr", b"nope.exr": "left out: nope.exr"}


class Attacks:
    """Models, each in a folder of its own, with the command lines that take them and what they say."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rows: dict[str, tuple[list[str | Path], str]] = {}

    def model(self, name: str, says: str, **changed: bytes) -> Path:
        """Copy the sample's model, with other bytes in some files."""
        place = self.folder / f"m{len(self.rows)}"
        shutil.copytree(LINEAR / "sparse", place)
        for part, data in changed.items():
            (place / f"{part}.bin").write_bytes(data)
        workspace = self.folder / f"w{len(self.rows)}"
        words = ["run", "--colmap", place, "--images", LINEAR / "images", "--workspace", workspace]
        self.rows[name] = [*words, "--to", "adopt_model"], says
        return place

    def as_text(self, name: str, says: str) -> Path:
        """Copy the sample's model as text."""
        place = self.model(name, says)
        for file in place.iterdir():
            file.unlink()
        pycolmap.Reconstruction(LINEAR / "sparse").write_text(place)
        return place


def refused_in(folder: Path) -> Attacks:
    """Write all that has to be refused."""
    made = Attacks(folder)
    for part, data in WHOLE.items():
        made.model(f"empty {part}", CUT, **{part: b""})
        made.model(f"2^40 {part}", CUT, **{part: struct.pack("<Q", 2**40) + data[8:]})
        made.model(f"cut {part}", CUT, **{part: data[:-1]})
        made.model(f"zeros behind {part}", "goes on for", **{part: data + bytes(1000)})
    for image, says in NAMES.items():
        made.model(f"name {image[:12]!r}", says, images=WHOLE["images"].replace(FIRST, image + b"\0", 1))
    for name, (params, size) in CAMERAS.items():
        model = pycolmap.Reconstruction(LINEAR / "sparse")
        for camera in model.cameras.values():
            camera.params = params
            for side, pixels in size.items():
                setattr(camera, side, pixels)
        model.write_binary(made.model(f"camera: {name}", IMPOSSIBLE))
    for name, (quaternion, translation) in POSES.items():
        frames = bytearray(WHOLE["frames"])
        frames[16:72] = struct.pack("<7d", *quaternion, *translation)
        made.model(f"pose: {name}", NO_POSE, frames=bytes(frames))
    for name, (part, before, after, says) in TEXTS.items():
        file = made.as_text(name, says) / f"{part}.txt"
        file.write_text(file.read_text().replace(before, after, 1))
    for name, text in POINTS.items():
        (made.as_text(name, NOT_READ) / "points3D.txt").write_text(text)
    (made.as_text("text: bytes", NOT_READ) / "images.txt").write_bytes(bytes(range(256)) * 50)
    for name, make in KINDS.items():
        for part in ("images", "points3D"):
            place = made.model(f"{part} is a {name}", NO_FILE * (name != "loop")) / f"{part}.bin"
            place.unlink()
            make(place)
    cameras = made.model("cameras is a folder", "There is no COLMAP model") / "cameras.bin"
    cameras.unlink()
    cameras.mkdir()
    for name, data in STORED.items():
        (made.model(f"list of photos as stored: {name}", "as_stored.json") / "as_stored.json").write_bytes(
            data
        )
    return made


@pytest.fixture(scope="module")
def refusals(tmp_path_factory, tried) -> dict[str, tuple[Answer, str]]:
    """What came of every attack, and what is to be said of it."""
    folder = tmp_path_factory.mktemp("deep") / "models"
    folder.mkdir()
    made = refused_in(folder)
    answers = answers_of(made.rows, folder)
    tried("hostile COLMAP models", "refused in a sentence", len(answers))
    assert not list(folder.parent.rglob("x.exr")), "something was written outside the workspace"
    return answers


def test_every_one_is_refused_in_a_sentence_at_once_and_in_little_memory(refusals):
    assert len(refusals) > 60
    for answer, says in refusals.values():
        expect_refusal(answer, says, most_mb=600)


def test_an_image_without_a_photo_is_counted(tmp_path, tried):
    made = Attacks(tmp_path)
    for image, says in LEFT_OUT.items():
        made.model(repr(image), says, images=WHOLE["images"].replace(FIRST, image + b"\0", 1))
    answers = obey([words for words, _ in made.rows.values()], tmp_path)
    for answer, (_, says) in zip(answers, made.rows.values(), strict=True):
        assert answer.code == 0, answer
        assert f"1 of the 4 images of the model have no photo in {LINEAR}/images" in answer.said
        assert says in answer.said
    tried("images of a model without photos", "left out, named and counted", len(answers))


def test_a_list_of_photos_as_stored_is_part_of_what_the_result_depends_on(tmp_path):
    made = Attacks(tmp_path)
    for name, photos in {"none": [], "one": ["001.exr"]}.items():
        (made.model(name, "") / "as_stored.json").write_text(json.dumps(photos))
    none, one = [words for words, _ in made.rows.values()]
    one[one.index("--workspace") + 1] = none[none.index("--workspace") + 1]
    assert "as_stored.json has other content" in obey([none, one], tmp_path)[1].said
