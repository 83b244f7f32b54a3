"""Kinds of files: only regular ones are opened, for a pipe waits for ever and a device may never end."""

from __future__ import annotations

import stat
from pathlib import Path

from pipeline.errors import UserError

FILE, FOLDER = "a file", "a folder"
KINDS = (
    (stat.S_ISREG, FILE),
    (stat.S_ISDIR, FOLDER),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def kind_of_file(path: Path) -> str:
    """Name what lies at a path, links followed, without opening it: `FILE`, `FOLDER`, "a device", …

    Raises
    ------
    OSError
        There is nothing, or it cannot be looked up.
    """
    mode = path.stat().st_mode
    return next((name for is_one, name in KINDS if is_one(mode)), "of an unknown kind")


def is_folder(path: Path) -> bool:
    """Test whether there is a folder at a path; there is none at one that is too long, or in a loop."""
    return _is(FOLDER, path)


def is_file(path: Path) -> bool:
    """Test whether there is a file at a path; there is none in a folder that is closed, or on a dead disk."""
    return _is(FILE, path)


def _is(kind: str, path: Path) -> bool:
    try:
        return kind_of_file(path) == kind
    except OSError:
        return False


def expect_file(path: Path) -> None:
    """Refuse to open what is no regular file.

    Raises
    ------
    UserError
        It is a folder, a pipe, a socket or a device.
    OSError
        There is nothing, or it cannot be looked up.
    """
    if (kind := kind_of_file(path)) != FILE:
        raise UserError(f"{path} is {kind}; expected a file. Remove it, or move it elsewhere.")
