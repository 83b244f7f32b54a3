"""`output/`: copies of the newest results under stable names."""

from __future__ import annotations

import json
import shutil
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from posixpath import commonpath
from typing import Any

from pipeline.digest import replace_text
from pipeline.json_text import json_text
from pipeline.record import Record
from pipeline.stage import AnyStage, Artefact
from pipeline.store import Store

Digests = Mapping[str, Mapping[str, str]]  # by artefact or source, then by file
PART = ".unshade-part"  # of the name of a copy while it is written
UNKNOWN = ""  # the stage of entries from a ledger that did not yet record stage and key


class Output:
    """Copies of the newest results in `output/`, updated only where they changed.

    Copies, not links: editing a file there must not damage the cache. A ledger lists the copied files per
    artefact, with the result they belong to; other files in `output/` are never touched. `flow` has the names
    of the stages of the dataflow.
    """

    def __init__(self, workspace: Path, store: Store, flow: Collection[str]) -> None:
        self.root = workspace / "output"
        self._store = store
        self._flow = flow
        self._ledger = store.root / "output.json"

    def clear_up(self) -> None:
        """Delete copies that an interrupted run began. Only under the workspace's lock."""
        for left in self.root.rglob(f".*{PART}"):
            left.unlink(missing_ok=True)

    def show(self, stage: AnyStage, record: Record) -> None:
        """Copy the stage's artefacts into `output/`, and remove those that it no longer gives.

        Remove also the remaining files of a stage that is not in the dataflow now, where this stage gives the
        same artefacts.
        """
        shown = self._shown()
        given = {artefact.name: artefact for artefact in stage.gives if artefact.output is not None}
        replaced = {shown[name]["stage"] for name in given if name in shown} - {UNKNOWN, *self._flow}
        gone = {stage.name, *replaced}
        for name in [name for name, one in shown.items() if one["stage"] in gone and name not in given]:
            self._take_away(shown.pop(name)["files"])
        for artefact in given.values():
            self._show_artefact(artefact, record, shown)
        if shown != self._shown():
            replace_text(self._ledger, json_text(shown, indent=1) + "\n")

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
        for target, (file, digest) in wanted.items():
            if before.get(target) != [digest, _stamp(self.root / target)]:
                _copy(file, self.root / target)
        self._take_away(before.keys() - wanted.keys())
        files = {target: [digest, _stamp(self.root / target)] for target, (_, digest) in wanted.items()}
        shown[artefact.name] = {"stage": record.stage, "key": record.key, "files": files}

    def _take_away(self, targets: Iterable[str]) -> None:
        """Remove files, and folders that are empty then."""
        for target in targets:
            file = self.root / target
            file.unlink(missing_ok=True)
            for folder in file.relative_to(self.root).parents[:-1]:
                with suppress(OSError):  # not empty
                    (self.root / folder).rmdir()

    def _target(self, artefact: Artefact, name: str) -> str:
        """Compute the path below `output/`; for a single file it is the artefact's `output` itself."""
        return str(artefact.output) if artefact.file else f"{artefact.output}/{name}"

    def _shown(self) -> dict[str, Any]:
        """Read the ledger: by artefact, stage, key, and files with their digests and stamps."""
        try:
            ledger = json.loads(self._ledger.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return {name: one if "key" in one else _of_unknown_origin(one) for name, one in ledger.items()}


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


def _of_unknown_origin(files: Mapping[str, Any]) -> dict[str, Any]:
    """Convert an entry of an old ledger, which did not record stage and key."""
    return {"stage": UNKNOWN, "key": "", "files": files}


def _place(targets: Collection[str]) -> str:
    """Abbreviate the paths of an artefact's files: one path, or a folder with a pattern."""
    if len(targets) == 1:
        return next(iter(targets))
    kinds = {Path(target).suffix for target in targets}
    return f"{commonpath(targets)}/*{kinds.pop() if len(kinds) == 1 else ''}"


def _stamp(path: Path) -> list[int] | None:
    """Read size and modification time, by which a modified copy is detected."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return [stat.st_size, stat.st_mtime_ns]


def _copy(file: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    fresh = target.with_name(f".{target.name}{PART}")
    shutil.copyfile(file, fresh)
    fresh.replace(target)
