"""The program as a process, on five photos so small that every stage takes a moment."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path

from pipeline.cache.digest import digest_file
from pipeline.cache.record import Record, read_record
from stages.command.report import FILES
from tests.faults.program import PHOTOS, PROGRAM, ROOT

SMALL = {
    "sfm.max_size_px": 400,
    "undistort.max_size_px": 96,
    "raycast.reduce": 1,
    "mvs.sweep_planes": 32,
    "decomposition.mode": "paper",
    "decomposition.paper.max_alternations": 1,
}
STAGES = ("sfm", "undistort", "mvs", "mesh", "raycast", "correspondence", "decomposition", "export",
          "report")  # fmt: skip
OF_THE_MOMENT = {
    "record.json",
    "log.txt",
    "current.json",
    "digests.json",
    "output.json",
    *FILES,
}  # have times


def link_photos(folder: Path, count: int = 5) -> Path:
    """Make a folder of photos, of one file system's bytes."""
    folder.mkdir(parents=True)
    for path in sorted(PHOTOS.glob("*.jpg"))[:count]:
        os.link(path, folder / path.name)
    return folder


def words(
    verb: str, workspace: Path | str | bytes, *more: str, photos: Path | None = None
) -> list[str | bytes]:
    """The command line of a small run, or of another command about it."""
    photos = photos or Path(os.fsdecode(workspace)).parent / "photos"
    settings = [word for name, value in SMALL.items() for word in ("--set", f"{name}={value}")]
    given: list[str | bytes] = ["--workspace", workspace if isinstance(workspace, bytes) else str(workspace)]
    if verb in {"run", "plan"}:
        given += ["--images", str(photos), *settings]
    return [*PROGRAM, verb, *given, *more]


def environment(changes: Mapping[str, str | None] | None = None) -> dict[str, str]:
    """The environment of these tests with some variables set, and those that are None taken away."""
    values = {**os.environ, "PYTHONPATH": str(ROOT), **(changes or {})}
    return {name: value for name, value in values.items() if value is not None}


def do(
    line: Iterable[str | bytes], changes: Mapping[str, str | None] | None = None, timeout: float = 600, **how
) -> subprocess.CompletedProcess[str]:
    """Execute a command line to its end."""
    return subprocess.run(
        list(line), env=environment(changes), timeout=timeout, check=False, cwd=how.pop("cwd", ROOT),
        **({"capture_output": True, "text": True, "errors": "replace"} | how),
    )  # fmt: skip


def one_line(text: str) -> str:
    return " ".join(text.split())


def results(workspace: Path) -> dict[str, str]:
    """Digest every file of cache and output that does not depend on the moment."""
    files = [path for room in ("cache", "output") for path in (workspace / room).rglob("*")]
    return {
        str(path.relative_to(workspace)): digest_file(path)
        for path in files
        if path.is_file() and path.name not in OF_THE_MOMENT and not _is_hidden(path, workspace)
    }


def leftovers(*folders: Path) -> list[str]:
    """Temporary files and folders: hidden ones, but for the lock."""
    return [
        str(path)
        for folder in folders
        for path in folder.rglob("*")
        if path.name.startswith(".") and path.name != ".lock"
    ]


def published(workspace: Path) -> list[Record]:
    """The record of every visible result; raises where one has none."""
    return [read_record(entry) for entry in sorted((workspace / "cache").glob("*/[!.]*"))]


def _is_hidden(path: Path, workspace: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(workspace).parts)
