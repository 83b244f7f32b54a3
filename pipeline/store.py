"""The cache on disk: `cache/STAGE/KEY/`, published atomically and verified before reuse."""

from __future__ import annotations

import json
import os
import shutil
import uuid
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from pipeline.digest import DigestMemo, replace_text
from pipeline.json_text import json_text
from pipeline.record import RECORD, Record, read_record, write_record
from pipeline.stage import AnyStage

PARTIAL = ".partial-"


class Store:
    """All results of one workspace.

    Parameters
    ----------
    workspace : Path
        Its `cache/` holds the results; `cache/current.json` names the newest of each stage.
    """

    def __init__(self, workspace: Path) -> None:
        self.root = workspace / "cache"
        self.memo = DigestMemo(self.root / "digests.json")

    def entry(self, stage: str, key: str) -> Path:
        """Compute the folder of a result, which need not exist."""
        return self.root / stage / key

    def record(self, stage: str, key: str) -> Record | None:
        """Read the record of a result; None if there is no such result."""
        return read_record(self.entry(stage, key))

    def records(self, stage: str) -> list[Record]:
        """List the records of all results of a stage, oldest first."""
        folder = self.root / stage
        if not folder.is_dir():
            return []
        found = [read_record(entry) for entry in folder.iterdir() if not entry.name.startswith(".")]
        return sorted((record for record in found if record), key=lambda record: record.finished)

    def current(self, stage: str) -> Record | None:
        """Read the record of the result that the last run made or used."""
        key = self._current_keys().get(stage)
        return self.record(stage, key) if key else None

    def set_current(self, stage: str, key: str) -> None:
        """Store which result the last run made or used."""
        keys = self._current_keys()
        if keys.get(stage) != key:
            replace_text(self.root / "current.json", json_text({**keys, stage: key}, indent=1) + "\n")

    def _current_keys(self) -> dict[str, str]:
        try:
            return json.loads((self.root / "current.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}

    def damage(self, stage: AnyStage, record: Record) -> str | None:
        """Describe the damage of a cached result; None if every file is as it was published."""
        entry = self.entry(record.stage, record.key)
        for artefact in stage.gives:
            published = record.outputs.get(artefact.name)
            if published is None:
                return f"its record does not know {artefact.name}"
            found = self.digests(entry / artefact.path)
            for name in published.keys() | found.keys():
                if found.get(name) != published.get(name):
                    return f"{artefact.path}{_below(artefact.path, name)} {_harm(name, found, published)}"
        return None

    def digests(self, path: Path) -> dict[str, str]:
        """Compute digests of the files at or below `path` in the cache; empty where there are none."""
        return self.memo.tree(path) if path.exists() else {}

    def begin(self, stage: str) -> Path:
        """Create a private folder in which a result is prepared, invisible until `publish`."""
        folder = self.root / stage / f"{PARTIAL}{uuid.uuid4().hex[:12]}"
        folder.mkdir(parents=True)
        return folder

    def publish(self, partial: Path, record: Record) -> None:
        """Publish a finished folder as the result of `record.key`, atomically.

        The record is written last, then one rename makes the folder visible. An existing result is moved
        aside first.
        """
        write_record(partial, record)
        _flush(partial)
        entry = self.entry(record.stage, record.key)
        if entry.exists():
            entry.rename(self.begin(record.stage) / "replaced")
        partial.rename(entry)
        self.memo.renamed(partial, entry)
        _flush_folder(entry.parent)
        self.sweep(record.stage)

    def sweep(self, stage: str) -> None:
        """Delete partial results of an interrupted run. Only under the workspace's lock."""
        folder = self.root / stage
        if folder.is_dir():
            for left in folder.glob(f"{PARTIAL}*"):
                shutil.rmtree(left, ignore_errors=True)

    def clear_up(self) -> list[str]:
        """Delete what an interrupted run left, of any stage; returns the names of the stages that it was in.

        Only under the workspace's lock.
        """
        interrupted = sorted({left.parent.name for left in self.root.glob(f"*/{PARTIAL}*")})
        for stage in interrupted:
            self.sweep(stage)
        for left in self.root.glob(".*.json.*"):  # of `replace_text`
            left.unlink(missing_ok=True)
        return interrupted

    def remove(self, stage: str, key: str) -> int:
        """Delete a result; returns the bytes freed."""
        entry = self.entry(stage, key)
        freed = size_of(entry)
        (entry / RECORD).unlink(missing_ok=True)  # first: a record never remains without its files
        shutil.rmtree(entry)
        return freed


def size_of(folder: Path) -> int:
    """Sum the bytes of all files below `folder`; a run may delete some meanwhile."""
    size = 0
    for root, _, names in os.walk(folder):
        for name in names:
            with suppress(OSError):
                size += Path(root, name).stat().st_size
    return size


def _below(artefact_path: str, name: str) -> str:
    return "" if artefact_path == name else f"/{name}"


def _harm(name: str, found: Mapping[str, str], published: Mapping[str, str]) -> str:
    if name not in found:
        return "is missing"
    return "was changed" if name in published else "was added"


def _flush(folder: Path) -> None:
    """Flush every file below `folder` to disk, so that a power failure cannot leave empty published files."""
    for path in folder.rglob("*"):
        if path.is_file():
            with path.open("rb") as file:
                os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
