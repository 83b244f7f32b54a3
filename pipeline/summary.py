"""The summary of a workspace: files in `output/` that tell of all results, written outside the cache.

They may hold what no key knows, such as times and memory: so they are made anew at the end of every run.
"""

from __future__ import annotations

from pathlib import Path

from pipeline.cache.record import Record
from pipeline.cache.store import Store
from pipeline.errors import UserError
from pipeline.files.boundary import check_own_folder
from pipeline.files.replacing import replace_text
from pipeline.request import Request, Result
from pipeline.stage import Flow


def consistent_results(flow: Flow, store: Store) -> dict[str, Record]:
    """Read the current results of a dataflow that were made from one another, by stage.

    One that was made from another result than the current one of an earlier stage is left out, and so is
    what follows from it. Sources are not looked at.
    """
    made = {artefact.name for stage in flow for artefact in stage.gives}
    found: dict[str, Record] = {}
    available: dict[str, object] = {}
    for stage in flow:
        record = store.current(stage.name)
        if record is None or {artefact.name for artefact in stage.gives} != record.outputs.keys():
            continue
        inputs = {name: files for name, files in record.inputs.items() if name in made}
        if all(available.get(name) == files for name, files in inputs.items()):
            found[stage.name] = record
            available |= record.outputs
    return found


def write_summary(request: Request, store: Store) -> list[Path]:
    """Write what the request's summary makes of the results; returns the files. Unchanged ones are left.

    Raises
    ------
    UserError
        A file cannot be written.
    """
    if request.summary is None:
        return []
    records = consistent_results(request.flow, store)
    results = {name: Result(record, store.entry(name, record.key)) for name, record in records.items()}
    written = []
    for name, text in request.summary(results).items():
        path = request.workspace / "output" / name
        check_own_folder(path.parent, request.workspace)
        try:
            if not _holds(path, text):
                replace_text(path, text)
        except OSError as error:
            raise UserError(
                f"{path} cannot be written ({error.strerror}); expected a place for a few megabytes. "
                "Make room, or move away what is there, and run again: the results are kept."
            ) from error
        written.append(path)
    return written


def _holds(path: Path, text: str) -> bool:
    """Check whether a file, not a link to one, has this text already."""
    there = path.is_file() and not path.is_symlink()
    return there and path.read_bytes() == text.encode("utf-8", "surrogateescape")
