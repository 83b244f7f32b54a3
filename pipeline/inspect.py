"""Inspection of a workspace: state of every stage, records, differences between results, pruning."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from pipeline.cache.key import FileDigests
from pipeline.cache.reasons import changed_files, differences
from pipeline.cache.record import Record
from pipeline.cache.store import Store, size_of
from pipeline.errors import UserError
from pipeline.request import Result
from pipeline.settings import near


def find_record(store: Store, stage: str, key: str | None = None) -> Record:
    """Find the stage's current result, or the one whose key begins with `key`.

    Raises
    ------
    UserError
        There is none, or several keys begin so.
    """
    records = _records_of(store, stage)
    if key is None:
        return store.current(stage) or records[-1]
    fitting = [record for record in records if record.key.startswith(key)]
    if len(fitting) != 1:
        keys = ", ".join(record.key[:12] for record in records)
        found = "no result has" if not fitting else "several results have"
        raise UserError(f"{stage}: {found} a key that begins with {key!r}; there are {keys}.")
    return fitting[0]


def _records_of(store: Store, stage: str) -> list[Record]:
    """List a stage's records, oldest first; refuse where there are none."""
    stages = _stages(store)
    if records := store.records(stage) if stage in stages else []:
        return records
    if damaged := store.keys(stage) if stage in stages else []:
        harm = store.damaged_record(stage, damaged[-1]) or "it is no folder"
        raise UserError(
            f"{store.root.parent} holds {len(damaged)} result(s) of {stage!r}, none with a sound record "
            f"({damaged[-1][:12]}: {harm}); run the stage again."
        )
    hint = near(stage, stages) if stages and stage not in stages else "run it first."
    raise UserError(f"{store.root.parent} holds no result of {stage!r}; {hint}")


def two_newest(store: Store, stage: str) -> tuple[Record, Record]:
    """Find the result before the newest, and the newest: the current one, even if the clock was set back.

    Raises
    ------
    UserError
        There are fewer than two.
    """
    records = _records_of(store, stage)
    if len(records) < 2:
        raise UserError(
            f"{store.root.parent} holds {len(records)} result(s) of {stage!r}; comparing takes two."
        )
    if (current := store.current(stage)) in records:
        records = [*(record for record in records if record != current), current]
    return records[-2], records[-1]


def compare(before: Record, now: Record) -> dict[str, list[str]]:
    """List the differences between two results of a stage: ingredients, outputs and facts."""
    outputs = [
        f"{name}: {changed_files(now.outputs.get(name, {}), before.outputs.get(name, {}))}"
        for name in sorted({*now.outputs, *before.outputs})
        if now.outputs.get(name) != before.outputs.get(name)
    ]
    facts = [
        f"{name}: {before.facts.get(name)} → {now.facts.get(name)}"
        for name in sorted({*now.facts, *before.facts})
        if now.facts.get(name) != before.facts.get(name)
    ]
    return {"made from": list(differences(now, before)), "outputs": outputs, "facts": facts}


def connected_results(store: Store, stage: str) -> dict[str, Result]:
    """Collect the current results around that of a stage: what it was made from, and what was made of these.

    A current result with an input that is another than the one collected is left out. Empty where the stage
    has none.
    """
    current = {name: record for name in _stages(store) if (record := store.current(name)) is not None}
    if stage not in current:
        return {}
    made = {artefact for record in current.values() for artefact in record.outputs}
    found = {stage: current[stage]}
    while True:
        added = {
            name: record
            for name, record in current.items()
            if name not in found and _belongs(record, found.values(), made)
        }
        if not added:
            return {name: Result(record, store.entry(name, record.key)) for name, record in found.items()}
        found |= added


def _belongs(record: Record, found: Collection[Record], made: Collection[str]) -> bool:
    """Check whether a result went into one of those found, or was made of what they hold and of sources."""
    for other in found:
        shared = other.inputs.keys() & record.outputs.keys()
        if shared and all(other.inputs[name] == record.outputs[name] for name in shared):
            return True
    outputs: dict[str, FileDigests] = {}
    for other in found:
        outputs |= other.outputs
    taken = {name: files for name, files in record.inputs.items() if name in made}
    return bool(taken) and all(outputs.get(name) == files for name, files in taken.items())


def prune(store: Store, everything: bool = False) -> dict[str, Any]:
    """Delete every result but the current one of each stage, or all of them; returns what was freed.

    Where it is not known which is current, the newest is kept. What is no result stays.
    """
    removed, freed = [], 0
    for stage in _stages(store):
        store.sweep(stage)
        kept = None if everything else store.latest(stage)
        for key in store.keys(stage):
            if kept is None or key != kept.key:
                removed.append(f"{stage}/{key}")
                freed += store.remove(stage, key)
    return {"removed": removed, "freed_bytes": freed}


def overview(store: Store, order: Sequence[str]) -> list[dict[str, Any]]:
    """Summarise each stage that has results: the current one, their number and size; unknown stages last."""
    there = _stages(store)
    known = [stage for stage in order if stage in there]
    return [_row(store, stage) for stage in dict.fromkeys((*known, *there))]


def _row(store: Store, stage: str) -> dict[str, Any]:
    records = store.records(stage)
    current = store.latest(stage)
    return {
        "stage": stage,
        "results": len(records),
        "bytes": size_of(store.root / stage),
        "key": current.key if current else None,
        "finished": current.finished if current else None,
        "seconds": current.seconds if current else None,
        "cpu_seconds": current.cpu_seconds if current else None,
        "peak_bytes": current.peak_bytes if current else None,
        "warnings": list(current.warnings) if current else [],
    }


def _stages(store: Store) -> list[str]:
    return sorted(path.name for path in _folders(store.root))


def _folders(root: Path) -> list[Path]:
    return [path for path in root.iterdir() if path.is_dir()] if root.is_dir() else []
