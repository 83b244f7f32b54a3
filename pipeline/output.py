"""`output/`: copies of the newest results under stable names."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from pipeline.digest import replace_text
from pipeline.record import Record
from pipeline.stage import Artefact, Stage
from pipeline.store import Store


class Output:
    """Keeps `output/` equal to the newest results, copying only what changed.

    Copies, not links: whoever edits a file there must not damage the cache. What was put there is
    remembered per artefact; other files in `output/` are never touched.
    """

    def __init__(self, workspace: Path, store: Store) -> None:
        self.root = workspace / "output"
        self._store = store
        self._ledger = store.root / "output.json"

    def show(self, stage: Stage, record: Record) -> None:
        """Bring the stage's artefacts into `output/`."""
        shown = self._shown()
        for artefact in stage.gives:
            if artefact.output is not None:
                self._show_artefact(artefact, record, shown)
        if shown != self._shown():
            replace_text(self._ledger, json.dumps(shown, indent=1) + "\n")

    def _show_artefact(self, artefact: Artefact, record: Record, shown: dict[str, Any]) -> None:
        source = self._store.entry(record.stage, record.key) / artefact.path
        wanted = {
            self._target(artefact, name): (source if artefact.file else source / name, digest)
            for name, digest in record.outputs[artefact.name].items()
        }
        before = shown.get(artefact.name, {})
        for target, (file, digest) in wanted.items():
            if before.get(target) != [digest, _stamp(self.root / target)]:
                _copy(file, self.root / target)
        for target in before.keys() - wanted.keys():
            (self.root / target).unlink(missing_ok=True)
        shown[artefact.name] = {
            target: [digest, _stamp(self.root / target)] for target, (_, digest) in wanted.items()
        }

    def _target(self, artefact: Artefact, name: str) -> str:
        """Path below `output/`; a single file takes the artefact's output as its own name."""
        return str(artefact.output) if artefact.file else f"{artefact.output}/{name}"

    def _shown(self) -> dict[str, Any]:
        try:
            return json.loads(self._ledger.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}


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
