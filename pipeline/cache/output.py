"""`output/`: copies of the newest results under stable names."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from posixpath import commonpath
from typing import Any

from pipeline.cache.record import Record
from pipeline.cache.sealed_json import read_sealed, sealed
from pipeline.cache.store import Store
from pipeline.errors import UserError
from pipeline.files.boundary import check_own_folder
from pipeline.files.replacing import FRESH, replace_copy, replace_text
from pipeline.stage import AnyStage, Artefact

Digests = Mapping[str, Mapping[str, str]]  # by artefact or source, then by file
BEGUN = ["", 0]  # in place of digest and stamp, of a copy that may be there
UNKNOWN = ""  # the stage of entries from a ledger that did not yet record stage and key


class Output:
    """Copies of the newest results in `output/`, updated only where they changed.

    Copies, not links: editing a file there must not damage the cache. A ledger lists the copied files per
    artefact, with the result they belong to; other files in `output/` are never touched. `flow` has the names
    of the stages of the dataflow.
    """

    def __init__(self, workspace: Path, store: Store, flow: Collection[str]) -> None:
        self.root = workspace / "output"
        self._workspace = workspace
        self._store = store
        self._flow = flow
        self._ledger = store.root / "output.json"

    def clear_up(self) -> None:
        """Delete the copy that an interrupted run began. Only under the workspace's lock."""
        check_own_folder(self.root, self._workspace)
        with suppress(IsADirectoryError, PermissionError):  # a folder there is not ours
            (self.root / FRESH).unlink(missing_ok=True)

    def show(self, stage: AnyStage, record: Record) -> None:
        """Copy the stage's artefacts into `output/`, and remove those that it no longer gives.

        Remove also all that remains of a stage that is not in the dataflow now, where this stage gives the
        same artefacts, or files in the places of its own.
        """
        shown = self._shown()
        given = {artefact.name: artefact for artefact in stage.gives if artefact.output is not None}
        places = {
            self._target(artefact, name)
            for artefact in given.values()
            for name in record.outputs[artefact.name]
        }
        replaced = {
            one["stage"]
            for name, one in shown.items()
            if name in given or not places.isdisjoint(one["files"])
        } - {UNKNOWN, *self._flow}
        gone = {stage.name, *replaced}
        for name in [name for name, one in shown.items() if one["stage"] in gone and name not in given]:
            self._take_away(shown.pop(name)["files"])
        for artefact in given.values():
            self._show_artefact(artefact, record, shown)
        if shown != self._shown():
            replace_text(self._ledger, sealed(shown))

    def outdated(self, later: Iterable[AnyStage], available: Digests) -> list[str]:
        """Describe files in `output/` that were made from other inputs than the present ones.

        Parameters
        ----------
        later : iterable of Stage
            Stages of the dataflow after the last one that ran, in order.
        available : mapping of str to mapping of str to str
            Digests of the files of each source and artefact of the run that has just ended.
        """
        stale: set[str] = set()
        for stage in later:
            record = self._store.current(stage.name)
            if record and _outgrown(record, available, stale):
                stale |= {artefact.name for artefact in stage.gives}
        places: dict[tuple[str, str], list[str]] = {}
        for one in self._shown().values():
            if one["files"]:
                places.setdefault((one["stage"], one["key"]), []).append(_place(one["files"]))
        sentences = []
        for (name, key), shown in places.items():
            record = self._store.record(name, key)
            if other := _outgrown(record, available, stale) if record else []:
                sentences.append(_of_an_earlier_run(name, sorted(shown), other))
        return sentences

    def _show_artefact(self, artefact: Artefact, record: Record, shown: dict[str, Any]) -> None:
        source = self._store.entry(record.stage, record.key) / artefact.path
        wanted = {
            self._target(artefact, name): (source if artefact.file else source / name, digest)
            for name, digest in record.outputs[artefact.name].items()
        }
        before = shown.get(artefact.name, {"files": {}})["files"]
        self._take_away(before.keys() - wanted.keys())
        self._make_way(wanted.keys(), shown)
        copied = {
            target: file
            for target, (file, digest) in wanted.items()
            if before.get(target) != [digest, _stamp(self.root / target)]
        }
        if copied:  # in the ledger before they are in their places: who interrupts leaves nothing unknown
            begun = {target: before.get(target, BEGUN) for target in wanted}
            shown[artefact.name] = {"stage": record.stage, "key": record.key, "files": begun}
            replace_text(self._ledger, sealed(shown))
        for target, file in copied.items():
            self._copy(file, self.root / target)
        files = {target: [digest, _stamp(self.root / target)] for target, (_, digest) in wanted.items()}
        shown[artefact.name] = {"stage": record.stage, "key": record.key, "files": files}

    def _make_way(self, targets: Collection[str], shown: dict[str, Any]) -> None:
        """Remove copies of other results where folders have to be, or in folders where files have to be."""
        folders = set().union(*map(_folders_of, targets))
        for one in shown.values():
            files = one["files"]
            obstacles = [
                name for name in files if name in folders or not _folders_of(name).isdisjoint(targets)
            ]
            self._take_away(obstacles)
            one["files"] = {name: stamp for name, stamp in files.items() if name not in obstacles}

    def _take_away(self, targets: Iterable[str]) -> None:
        """Remove files, and folders that are empty then."""
        for target in targets:
            file = self.root / target
            check_own_folder(file.parent, self._workspace)
            if file.is_symlink() or file.is_file():
                with _explained(file):
                    file.unlink()
            for folder in file.relative_to(self.root).parents[:-1]:
                with suppress(OSError):  # not empty
                    (self.root / folder).rmdir()

    def _copy(self, file: Path, target: Path) -> None:
        """Copy a file of the cache to its place, by way of one whose name is short: its own may be long."""
        if not file.is_file():
            raise UserError(f"{file} is gone: it was deleted during the run. Run again, and it is made anew.")
        check_own_folder(target.parent, self._workspace)
        if (self.root / FRESH).is_dir():
            raise UserError(f"{self.root / FRESH} is in the way: expected nothing there. Move it elsewhere.")
        with _explained(target):
            target.parent.mkdir(parents=True, exist_ok=True)
            replace_copy(file, target, self.root / FRESH)

    def _target(self, artefact: Artefact, name: str) -> str:
        """Compute the path below `output/`; for a single file it is the artefact's `output` itself."""
        return str(artefact.output) if artefact.file else f"{artefact.output}/{name}"

    def _shown(self) -> dict[str, Any]:
        """Read the ledger: by artefact, stage, key, and files with their digests and stamps."""
        try:
            return {name: _entry(one) for name, one in read_sealed(self._ledger).items()}
        except (OSError, ValueError):
            return {}


def _outgrown(record: Record, available: Digests, stale: Collection[str]) -> list[str]:
    """List inputs of a result that have changed since, or depend on inputs that have."""
    return sorted(
        name
        for name, files in record.inputs.items()
        if name in stale or (name in available and available[name] != files)
    )


def _of_an_earlier_run(stage: str, places: Sequence[str], other: Sequence[str]) -> str:
    """Describe shown files that are outdated, and why; two inputs are named, more are counted."""
    reason = " and ".join(f"another {name}" for name in other[:2])
    if len(other) > 2:
        reason += f", and {len(other) - 2} more that differ"
    return f"Of an earlier run, in output: {', '.join(places)} ({stage} made it from {reason})."


def _entry(one: Any) -> dict[str, Any]:
    """Check an entry of the ledger; old ledgers did not record stage and key.

    Raises
    ------
    ValueError
        It has other types, or paths that are not below `output/`: a damaged ledger is worth nothing, since
        files are removed by it.
    """
    if not isinstance(one, dict):
        raise ValueError(f"{one!r} is no entry of a ledger")
    entry: dict[str, Any] = one if "key" in one else {"stage": UNKNOWN, "key": "", "files": one}
    match entry:
        case {"stage": str(), "key": str(), "files": dict()}:
            pass
        case _:
            raise ValueError(f"{one!r} is no entry of a ledger")
    for target, stamp in entry["files"].items():
        path = PurePosixPath(target)
        if not path.parts or path.is_absolute() or ".." in path.parts or "\0" in target:
            raise ValueError(f"{target!r} is no path below output/")
        if not isinstance(stamp, list):
            raise ValueError(f"{target!r} has no digest and stamp")
    return entry


@contextmanager
def _explained(target: Path) -> Iterator[None]:
    """Turn what the file system says against a file in `output/` into a sentence."""
    try:
        yield
    except OSError as error:
        raise UserError(
            f"{target} cannot be written ({error.strerror}); expected a place for a copy of the result. Make "
            "room, or move away what is there, and run again: the result itself is kept."
        ) from error


def _place(targets: Collection[str]) -> str:
    """Abbreviate the paths of an artefact's files: one path, or a folder with a pattern."""
    if len(targets) == 1:
        return next(iter(targets))
    kinds = {Path(target).suffix for target in targets}
    return f"{commonpath(targets)}/*{kinds.pop() if len(kinds) == 1 else ''}"


def _folders_of(target: str) -> set[str]:
    return {str(folder) for folder in PurePosixPath(target).parents}


def _stamp(path: Path) -> list[int] | None:
    """Read size and modification time, by which a modified copy is detected."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return [stat.st_size, stat.st_mtime_ns]
