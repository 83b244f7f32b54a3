"""The end of a run: a table of its stages and their cost, and the paths to open."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from pipeline.command.durations import spent
from pipeline.command.terminal import megabytes, table_of
from pipeline.plan import Action
from pipeline.request import Pointer, Request
from pipeline.run import Done


def run_table(done: Sequence[Done], request: Request, seconds: float) -> Table:
    """Lay out the stages of a run, the time that it took, and what to open."""
    page = Table.grid()
    page.add_column(overflow="fold")
    page.add_row(table_of([_row(one) for one in done], _COLUMNS))
    page.add_row()
    page.add_row(f"Up to date after {spent(seconds)}: {_from_here(results_of(request))}")
    if found := to_open(done, request):
        rows = [{"": "", "path": one.path + "/" * path.is_dir(), "about": one.about} for one, path in found]
        page.add_row(table_of(rows, {"": "", " ": "path", "  ": "about"}))
    return page


_COLUMNS = {"stage": "stage", "result": "result", "time": "time", "memory": "memory"}


def to_open(done: Sequence[Done], request: Request) -> list[tuple[Pointer, Path]]:
    """List what is there to open of the stages of a run: not what an earlier run with other stages left."""
    names = {one.record.stage for one in done}
    places = [
        (one, request.workspace / "output" / one.path) for one in request.pointers if one.stage in names
    ]
    return [(one, path) for one, path in places if path.exists()]


def results_of(request: Request) -> Path:
    """Locate the results: some stages have none in `output/`."""
    output = request.workspace / "output"
    return output if output.is_dir() else request.workspace / "cache"


def _row(one: Done) -> dict[str, str]:
    """Describe a stage: what a reused one cost is in its record, and not the cost of this run."""
    row = {"stage": one.record.stage, "result": "reused", "time": "", "memory": ""}
    if one.decision.action is Action.RUN:
        cost = {"time": spent(one.record.seconds), "memory": megabytes(one.record.peak_bytes)}
        row |= {"result": "ran"} | cost
    return row


def _from_here(path: Path) -> str:
    """Write a path as seen from the current folder, if it is below."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative
