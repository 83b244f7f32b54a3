"""Reason for running a stage, in one sentence: differences between its ingredients now and last time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pipeline.cache.key import Ingredients
from pipeline.cache.record import Record

NAMED_FILES = 3  # more than this and the rest is counted


def why_run(now: Ingredients, before: Record | None) -> str:
    """Explain a run by what changed since the last result; "it has never run here" if there is none."""
    if before is None:
        return "it has never run here"
    changes = list(differences(now, before))
    return "; ".join(changes) if changes else "its earlier result is gone"


def differences(now: Ingredients | Record, before: Ingredients | Record) -> Iterator[str]:
    """List the differences between the ingredients of two results, a phrase each."""
    if now.version != before.version:
        yield f"the stage itself went from version {before.version} to {now.version}"
    yield from _changed_values("setting", now.settings, before.settings)
    for name in sorted({*now.inputs, *before.inputs}):
        yield from _changed_input(name, now.inputs.get(name), before.inputs.get(name))
    yield from _changed_values("tool", now.tools, before.tools)
    yield from _changed_values("machine's", now.machine, before.machine)


def _changed_values(kind: str, now: Mapping[str, Any], before: Mapping[str, Any]) -> Iterator[str]:
    for name in sorted({*now, *before}):
        if name not in before:
            yield f"{kind} {name} is new"
        elif name not in now:
            yield f"{kind} {name} is gone"
        elif now[name] != before[name]:
            yield f"{kind} {name} went from {before[name]} to {now[name]}"


def _changed_input(
    name: str, now: Mapping[str, str] | None, before: Mapping[str, str] | None
) -> Iterator[str]:
    if now is None:
        yield f"input {name} is no longer given"
    elif before is None:
        yield f"input {name} is new"
    elif now != before:
        yield f"input {name} changed ({changed_files(now, before)})"


def changed_files(now: Mapping[str, str], before: Mapping[str, str]) -> str:
    """List which files were changed, added or removed, the first few by name."""
    changed = [f"{file} has other content" for file in now if file in before and now[file] != before[file]]
    added = [f"{file} is new" for file in now if file not in before]
    removed = [f"{file} is gone" for file in before if file not in now]
    everything = changed + added + removed
    named = ", ".join(everything[:NAMED_FILES])
    rest = len(everything) - NAMED_FILES
    return f"{named} and {rest} more" if rest > 0 else named
