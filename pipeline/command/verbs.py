"""The generic commands: run, plan, status, show, diff, clean. Each answers as a table and as JSON."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from pipeline.cache.record import Record
from pipeline.cache.store import Store
from pipeline.command.run_table import run_table, to_open
from pipeline.command.terminal import Terminal, megabytes, table_of
from pipeline.files.workspace_lock import locked, refusals_explained
from pipeline.inspect import compare, find_record, overview, prune, two_newest
from pipeline.plan import plan, read_sources
from pipeline.process.child import Ending, run_in_child
from pipeline.process.memory_limits import advice
from pipeline.request import Request
from pipeline.run import clear_up, run
from pipeline.stage import AnyStage

CRASHED = 1  # whatever code a library left with


def run_verb(request: Request, terminal: Terminal) -> None:
    """Bring the selected stages up to date; print what they cost, and what to open."""
    begun = perf_counter()
    done = run(request, terminal)
    seconds = perf_counter() - begun
    opened = [str(path) for _, path in to_open(done, request)]
    places = {"output": str(request.workspace / "output"), "to_open": opened}
    terminal.done(seconds=round(seconds, 3), **places)
    terminal.answer({"stages": [one.as_json() for one in done], **places}, run_table(done, request, seconds))


def do_in_child(work: Callable[[], int], request: Request, terminal: Terminal) -> int:
    """Do the work of a request in a child process; clear up after one that was killed; return the exit code.

    `work` prints the error that it meets, and returns the exit code.
    """
    ending = run_in_child(work)
    if ending.code == 0:
        return 0
    left = clear_up(request)  # nothing, where the child could tell its error itself
    if ending.signal is not None or left:
        terminal.restore()
        terminal.fail(_how_it_ended(ending, request, left, terminal.words))
    return CRASHED if left and ending.signal is None else ending.code


def _how_it_ended(ending: Ending, request: Request, left: Sequence[str], words: Sequence[str]) -> str:
    """Describe the end of a run that was killed in the stages `left`, and how to go on."""
    stages = [stage for stage in request.flow if stage.name in left]
    name = ending.signal.name if ending.signal else f"exit code {ending.code}"
    where = f" during {stages[0].name}" if stages else ""
    less = "".join(map(advice, stages)) or "Choose a smaller size or fewer --threads. "
    if ending.requested:
        how = "Interrupted" if name == "SIGINT" else f"Ended by {name}"
        return f"{how}{where}. {_kept(request, stages)} {how_to_go_on(words, stages)}"
    if name == "SIGKILL":
        return (
            f"The run was killed{where}, most likely by the system, because memory ran out. Close other "
            f"programs, or take less. {less}What was finished is kept, and the same command continues there."
        )
    return (
        f"Native code ended the run{where} ({name}), as it does where memory or the disk is full. Make room, "
        f"or take less. {less}What was finished is kept, and the same command continues there; if there was "
        "room, this is a fault of unshade or of a library."
    )


def _kept(request: Request, stages: Sequence[AnyStage]) -> str:
    """Say which results an interrupted run keeps."""
    number = request.flow.index(stages[0]) if stages else 0
    if not number:
        return "What was finished is kept."
    before = f"{number} stages" if number > 1 else "stage"
    return f"The results of the {before} before it are kept."


def how_to_go_on(words: Sequence[str], stages: Sequence[AnyStage] = ()) -> str:
    """Give the command that continues an interrupted one, if its words are known.

    With --force it would begin anew: then it is to begin with the stage that was interrupted.
    """
    if not words:
        return "The same command continues there."
    further = ("--from", stages[0].name) if stages and "--force" in words and "--only" not in words else ()
    return f"To go on: {shlex.join([*words, *further])}"


def plan_verb(request: Request, terminal: Terminal) -> None:
    """Print what a run would do, and why."""
    for sentence in request.remarks:
        terminal.say(sentence)
    with refusals_explained(request.workspace):
        store = Store(request.workspace)
        rows = [decision.as_json() for decision in plan(request, store, read_sources(request, store))]
    shown = [row | {"memory": _expected(row["memory_bytes"], row["memory_from"])} for row in rows]
    columns = {"stage": "stage", "": "action", "because": "reason"}
    if any(row["memory"] for row in shown):
        columns["memory"] = "memory"
    terminal.answer(rows, table_of(shown, columns))


def _expected(size: int | None, where_from: str | None) -> str:
    """Format the memory that a stage is expected to take."""
    return "" if size is None else f"{megabytes(size)} ({where_from})"


def status_verb(workspace: Path, order: Sequence[str], terminal: Terminal) -> None:
    """Print results and their cost, stage by stage in this order."""
    with refusals_explained(workspace):
        rows = overview(Store(workspace), order)
    for row in rows:
        row["peak"] = megabytes(row["peak_bytes"])
        row["size"] = megabytes(row["bytes"])
        row["when"] = (row["finished"] or "–")[:16].replace("T", " ")
        row["short"] = (row["key"] or "–")[:12]
        row["notes"] = len(row["warnings"])
    columns = {"stage": "stage", "result": "short", "finished (UTC)": "when", "seconds": "seconds"}
    costs = {
        "CPU-s": "cpu_seconds",
        "peak": "peak",
        "on disk": "size",
        "results": "results",
        "warnings": "notes",
    }
    terminal.answer(rows, table_of(rows, columns | costs))


def show_verb(workspace: Path, stage: str, key: str | None, terminal: Terminal) -> None:
    """Print the record of a result."""
    store = Store(workspace)
    with refusals_explained(workspace):
        record = find_record(store, stage, key)
    folder = store.entry(record.stage, record.key)
    rows = [{"what": name, "value": value} for name, value in _sayings(record, folder)]
    terminal.answer(record.as_json() | {"folder": str(folder)}, table_of(rows, {"": "what", " ": "value"}))


def _sayings(record: Record, folder: Path) -> list[tuple[str, Any]]:
    """List a record as pairs of a name and a value."""
    lines: list[tuple[str, Any]] = [("result", f"{record.stage} {record.key}"), ("folder", folder)]
    lines += [("finished", record.finished), ("seconds", record.seconds), ("CPU-seconds", record.cpu_seconds)]
    lines += [("peak memory", megabytes(record.peak_bytes)), ("version", record.version)]
    lines += [(f"setting {name}", value) for name, value in record.settings.items()]
    lines += [(f"tool {name}", value) for name, value in (*record.tools.items(), *record.machine.items())]
    lines += [(f"input {name}", f"{len(files)} file(s)") for name, files in record.inputs.items()]
    lines += [(f"output {name}", f"{len(files)} file(s)") for name, files in record.outputs.items()]
    lines += [(f"fact {name}", value) for name, value in record.facts.items()]
    return lines + [("warning", sentence) for sentence in record.warnings]


def diff_verb(workspace: Path, stage: str, keys: tuple[str, ...], terminal: Terminal) -> None:
    """Print the differences between two results of a stage: those named, or the newest and the one before."""
    store = Store(workspace)
    with refusals_explained(workspace):
        if len(keys) == 2:
            before, now = (find_record(store, stage, key) for key in keys)
        else:
            before, now = two_newest(store, stage)
    found = compare(before, now)
    rows = [
        {"where": where, "what": sentence} for where, sentences in found.items() for sentence in sentences
    ]
    table = table_of(rows or [{"where": "nothing differs"}], {"": "where", " ": "what"})
    terminal.answer({"before": before.key, "now": now.key, **found}, table)


def clean_verb(workspace: Path, everything: bool, terminal: Terminal) -> None:
    """Delete results that are not current, or all of them."""
    with locked(workspace):
        report = prune(Store(workspace), everything)
    removed = len(report["removed"])
    summary = f"{removed} result(s) removed, {megabytes(report['freed_bytes'])} freed"
    terminal.answer(report, table_of([{"what": summary}], {"": "what"}))
