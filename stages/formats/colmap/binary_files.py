"""COLMAP's binary files, walked through before a library reads them: pycolmap does not notice their end.

A file that was cut gives cameras with the last file's numbers, and a count that is not there eats all memory.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pycolmap

from pipeline import UserError

POSE, POINT2D, POINT3D, OBSERVATION = 7 * 8, 2 * 8 + 8, 8 + 3 * 8 + 3 + 8, 4 + 4  # bytes
CAMERA, IMAGE, RIG, FRAME, SENSOR = 4 + 4 + 8 + 8, 4 + POSE + 4, 4 + 4, 4 + 4 + POSE, 4 + 4


class _Reader:
    """A file's bytes, and how far they have been walked."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def take(self, kind: str) -> int:
        """Take the next whole number."""
        (value,) = struct.unpack_from(f"<{kind}", self.data, self.at)
        self.at += struct.calcsize(f"<{kind}")
        return value

    def skip(self, size: int) -> None:
        """Pass over bytes, which have to be there."""
        self.at += size
        if self.at > len(self.data):
            raise ValueError(f"{self.at - len(self.data)} bytes are missing")

    def skip_text(self) -> None:
        """Pass over a text and the zero behind it."""
        self.at = self.data.index(b"\0", self.at) + 1


def check_binary_files(folder: Path) -> dict[str, int]:
    """Walk through every binary file of a model.

    Returns
    -------
    dict of str to int
        How many ``cameras``, ``images``, ``points3D``, ``rigs``, ``frames`` those that are there hold.

    Raises
    ------
    UserError
        A file ends before all that it promises, or goes on after it.
    """
    return {
        part: _check_file(folder / f"{part}.bin", walk)
        for part, walk in WALKS.items()
        if (folder / f"{part}.bin").is_file()
    }


def _check_file(path: Path, walk: Callable[[_Reader], None]) -> int:
    reader = _Reader(path.read_bytes())
    count = 0
    try:
        count = reader.take("Q")
        for _ in range(count):
            walk(reader)
    except (ValueError, struct.error) as error:
        raise UserError(
            f"{path} promises {count} {path.stem} and ends before them ({len(reader.data)} bytes; {error}); "
            "it was cut off or damaged. Copy or export the model again."
        ) from error
    if reader.at != len(reader.data):
        raise UserError(
            f"{path} goes on for {len(reader.data) - reader.at} bytes after the {count} {path.stem} that it "
            "promises; it was damaged. Copy or export the model again."
        )
    return count


def _camera(reader: _Reader) -> None:
    reader.take("I")
    number = reader.take("i")
    reader.skip(CAMERA - 8)
    reader.skip(8 * _parameters(number))


@cache
def _parameters(model: int) -> int:
    """How many parameters a camera model has."""
    try:
        return len(pycolmap.Camera.create_from_model_id(1, pycolmap.CameraModelId(model), 1.0, 2, 2).params)
    except (ValueError, TypeError, RuntimeError, IndexError) as error:
        raise ValueError(f"there is no camera model {model}") from error


def _image(reader: _Reader) -> None:
    reader.skip(IMAGE)
    reader.skip_text()
    reader.skip(POINT2D * reader.take("Q"))


def _point(reader: _Reader) -> None:
    reader.skip(POINT3D)
    reader.skip(OBSERVATION * reader.take("Q"))


def _rig(reader: _Reader) -> None:
    reader.take("I")
    sensors = reader.take("I")
    if sensors:
        reader.skip(SENSOR)
    for _ in range(sensors - 1):
        reader.skip(SENSOR)
        if reader.take("B"):
            reader.skip(POSE)


def _frame(reader: _Reader) -> None:
    reader.skip(FRAME)
    reader.skip((SENSOR + 8) * reader.take("I"))


WALKS = {"cameras": _camera, "images": _image, "points3D": _point, "rigs": _rig, "frames": _frame}
