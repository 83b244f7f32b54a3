"""The cache on disk: `cache/STAGE/KEY/`, published atomically and verified before reuse."""

from __future__ import annotations

import os
import re
import shutil
import uuid
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from pipeline.cache.digest import DIGEST_HEX_DIGITS, DigestMemo
from pipeline.cache.record import RECORD, Record, read_record, write_record
from pipeline.cache.sealed_json import read_sealed, sealed
from pipeline.errors import UserError
from pipeline.files.boundary import check_own_folder
from pipeline.files.replacing import FRESH, replace_text
from pipeline.stage import AnyStage, Artefact

PARTIAL = ".partial-"
KEY = re.compile(rf"[0-9a-f]{{{DIGEST_HEX_DIGITS}}}")


class Store:
    """All results of one workspace.

    Parameters
    ----------
    workspace : Path
        Its `cache/` holds the results; `cache/current.json` names the newest of each stage.
    """

    def __init__(self, workspace: Path) -> None:
        self.root = workspace / "cache"
        self._workspace = workspace
        self.memo = DigestMemo(self.root / "digests.json")

    def entry(self, stage: str, key: str) -> Path:
        """Compute the folder of a result, which need not exist."""
        return self.root / stage / key

    def record(self, stage: str, key: str) -> Record | None:
        """Read the record of a result; None if there is no such result, or its record is damaged."""
        try:
            return read_record(self.entry(stage, key))
        except (OSError, ValueError):
            return None

    def damaged_record(self, stage: str, key: str) -> str | None:
        """Describe why a result whose folder is there has no record; None where it has, or there is none."""
        entry = self.entry(stage, key)
        if not entry.is_dir():
            return None
        try:
            read_record(entry)
        except FileNotFoundError:
            return f"{RECORD} is missing"
        except OSError as error:
            return f"{RECORD} cannot be read ({error.strerror})"
        except ValueError:
            return f"{RECORD} was changed"
        return None

    def keys(self, stage: str) -> list[str]:
        """List the keys of all results of a stage, those with a damaged record included, sorted."""
        folder = self.root / stage
        return (
            sorted(entry.name for entry in folder.iterdir() if KEY.fullmatch(entry.name))
            if folder.is_dir()
            else []
        )

    def records(self, stage: str) -> list[Record]:
        """List the records of all results of a stage, oldest first."""
        found = [self.record(stage, key) for key in self.keys(stage)]
        return sorted((record for record in found if record), key=lambda record: record.finished)

    def latest(self, stage: str) -> Record | None:
        """Read the record of the current result; of the newest, where it is not known which is current."""
        current = self.current(stage)
        if current is not None:
            return current
        records = self.records(stage)
        return records[-1] if records else None

    def current(self, stage: str) -> Record | None:
        """Read the record of the result that the last run made or used."""
        key = self._current_keys().get(stage)
        return self.record(stage, key) if key else None

    def set_current(self, stage: str, key: str) -> None:
        """Store which result the last run made or used."""
        keys = self._current_keys()
        if keys.get(stage) != key:
            replace_text(self.root / "current.json", sealed({**keys, stage: key}))

    def _current_keys(self) -> dict[str, str]:
        """Read which results are current; of none where the file is missing or damaged."""
        try:
            keys = read_sealed(self.root / "current.json")
        except (OSError, ValueError):
            return {}
        return {stage: key for stage, key in keys.items() if isinstance(key, str) and KEY.fullmatch(key)}

    def damage(self, stage: AnyStage, record: Record) -> str | None:
        """Describe the damage of a cached result; None if every file is as it was published."""
        entry = self.entry(record.stage, record.key)
        for artefact in stage.gives:
            published = record.outputs.get(artefact.name)
            if published is None:
                return f"its record does not know {artefact.name}"
            harm = self._damage_of(entry / artefact.path, artefact, published)
            if harm is not None:
                return harm
        return None

    def _damage_of(self, place: Path, artefact: Artefact, published: Mapping[str, str]) -> str | None:
        """Describe the damage of one artefact, by its first file in order of names."""
        if not (place.is_dir() if artefact.file is None else place.is_file()):
            return f"{artefact.path} is missing"
        try:
            found = self.digests(place)
        except OSError as error:
            return f"{artefact.path} cannot be read ({error.strerror})"
        except UserError:
            return (
                f"{artefact.path} holds a link that leads nowhere, a pipe, a device, or a name out of UTF-8"
            )
        for name in sorted(published.keys() | found.keys()):
            if found.get(name) != published.get(name):
                return f"{artefact.path}{_below(artefact.path, name)} {_harm(name, found, published)}"
        return None

    def digests(self, path: Path) -> dict[str, str]:
        """Compute digests of the files at or below `path` in the cache; empty where there are none."""
        return self.memo.tree(path) if path.exists() else {}

    def begin(self, stage: str) -> Path:
        """Create a private folder in which a result is prepared, invisible until `publish`."""
        folder = self._checked_folder(stage) / f"{PARTIAL}{uuid.uuid4().hex[:12]}"
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
        if os.path.lexists(entry):
            entry.rename(self.begin(record.stage) / record.key)
        partial.rename(entry)
        self.memo.renamed(partial, entry)
        _flush_folder(entry.parent)
        self.sweep(record.stage)

    def sweep(self, stage: str) -> None:
        """Delete partial results of an interrupted run. Only under the workspace's lock.

        A result that was moved aside, and not yet replaced when the run died, returns to its place.
        """
        folder = self._checked_folder(stage)
        for left in folder.glob(f"{PARTIAL}*"):
            for aside in left.glob("*"):
                if KEY.fullmatch(aside.name) and not os.path.lexists(folder / aside.name):
                    aside.rename(folder / aside.name)
            if left.is_symlink() or not left.is_dir():
                left.unlink(missing_ok=True)
            else:
                shutil.rmtree(left, ignore_errors=True)

    def clear_up(self) -> list[str]:
        """Delete what an interrupted run left, of any stage; returns the names of the stages that it was in.

        Only under the workspace's lock.
        """
        interrupted = sorted({left.parent.name for left in self.root.glob(f"*/{PARTIAL}*")})
        for stage in interrupted:
            self.sweep(stage)
        for left in self.root.glob(f".*{FRESH}"):
            left.unlink(missing_ok=True)
        return interrupted

    def remove(self, stage: str, key: str) -> int:
        """Delete a result; returns the bytes freed. Of a link, only the link is deleted."""
        entry = self._checked_folder(stage) / key
        if entry.is_symlink() or not entry.is_dir():
            entry.unlink()
            return 0
        freed = size_of(entry)
        (entry / RECORD).unlink(missing_ok=True)  # first: a record never remains without its files
        shutil.rmtree(entry)
        return freed

    def _checked_folder(self, stage: str) -> Path:
        """Compute the folder of a stage's results, for writing."""
        folder = self.root / stage
        check_own_folder(folder, self._workspace)
        return folder


def size_of(folder: Path) -> int:
    """Sum the bytes of all files below `folder`; those that vanish meanwhile count nothing."""
    total = 0
    for place, _, names in os.walk(folder):
        for name in names:
            with suppress(OSError):
                total += Path(place, name).stat().st_size
    return total


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
