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
UNKNOWN = ""  # the stage of what was shown before the ledger knew of which result it is


class Output:
    """Keeps `output/` equal to the newest results, copying only what changed.

    Copies, not links: whoever edits a file there must not damage the cache. What was put there is
    remembered per artefact, with the result that it is of; other files in `output/` are never touched.
    `flow` has the names of the stages that a run goes through.
    """

    def __init__(self, workspace: Path, store: Store, flow: Collection[str]) -> None:
        self.root = workspace / "output"
        self._store = store
        self._flow = flow
        self._ledger = store.root / "output.json"

    def show(self, stage: AnyStage, record: Record) -> None:
        """Bring the stage's artefacts into `output/`, and take away what it gave once and gives no more.

        And what is left of a stage that the dataflow does without now, where this one gives what that gave.
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
        """Sentences on what is shown there and was made from something else than what there is now.

        Parameters
        ----------
        later : iterable of Stage
            In order, those of the dataflow that the run did not come to.
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
                with suppress(OSError):  # something else lies in it
                    (self.root / folder).rmdir()

    def _target(self, artefact: Artefact, name: str) -> str:
        """Path below `output/`; a single file takes the artefact's output as its own name."""
        return str(artefact.output) if artefact.file else f"{artefact.output}/{name}"

    def _shown(self) -> dict[str, Any]:
        """By artefact: stage, key, and its files with their digests and stamps."""
        try:
            ledger = json.loads(self._ledger.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return {name: one if "key" in one else _of_unknown_origin(one) for name, one in ledger.items()}


def _outgrown(record: Record, available: Digests, stale: Collection[str]) -> list[str]:
    """Inputs of a result that are others by now, or are themselves made from such."""
    return sorted(
        name
        for name, files in record.inputs.items()
        if name in stale or (name in available and available[name] != files)
    )


def _of_an_earlier_run(stage: str, places: Sequence[str], other: Sequence[str]) -> str:
    """What is shown of a result, and why it is not of now; two inputs are named, more are counted."""
    reason = " and ".join(f"another {name}" for name in other[:2])
    if len(other) > 2:
        reason += f", and {len(other) - 2} more that differ"
    return f"Of an earlier run, in output: {', '.join(places)} ({stage} made it from {reason})."


def _of_unknown_origin(files: Mapping[str, Any]) -> dict[str, Any]:
    """A ledger's entry as it was written before it knew of which result it is."""
    return {"stage": UNKNOWN, "key": "", "files": files}


def _place(targets: Collection[str]) -> str:
    """A file, or in short the files of one kind in a folder."""
    if len(targets) == 1:
        return next(iter(targets))
    kinds = {Path(target).suffix for target in targets}
    return f"{commonpath(targets)}/*{kinds.pop() if len(kinds) == 1 else ''}"


def _stamp(path: Path) -> list[int] | None:
    """Size and change time, to notice that a copy was touched."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return [stat.st_size, stat.st_mtime_ns]


def _copy(file: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    fresh = target.with_name(f".{target.name}.part")
    shutil.copyfile(file, fresh)
    fresh.replace(target)
