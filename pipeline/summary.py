"""The summary of a workspace: files in `output/` that tell of all results, written outside the cache.

They may hold what no key knows, such as times and memory: so they are made anew at the end of every run.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from pipeline.cache.key import FileDigests
from pipeline.cache.record import Record
from pipeline.cache.store import Store
from pipeline.errors import UserError
from pipeline.files.boundary import check_own_folder
from pipeline.files.replacing import replace_text
from pipeline.request import Request, Result
from pipeline.stage import AnyStage, Flow


def consistent_results(flow: Flow, store: Store) -> dict[str, Record]:
    """Read the current results of a dataflow that were made from one another, by stage.

    One that was made from another result than the current one of an earlier stage is left out, and so is
    what follows from it. Neither sources nor versions are looked at: a result of an earlier version is one.
    """
    made = {artefact.name for stage in flow for artefact in stage.gives}
    found: dict[str, Record] = {}
    for stage in flow:
        record = store.current(stage.name)
        if record is None or _is_of_another_variant(record, stage, made):
            continue
        available = outputs_of(flow, found)
        inputs = {name: files for name, files in record.inputs.items() if name in made}
        if all(available.get(name) == files for name, files in inputs.items()):
            found[stage.name] = record
    return found


def _is_of_another_variant(record: Record, stage: AnyStage, made: Collection[str]) -> bool:
    """Check whether a result took what the stage does not take, or gave what another stage gives here."""
    own = {artefact.name for artefact in stage.gives}
    takes = {*stage.takes, *stage.may_take}
    return bool(record.inputs.keys() - takes or record.outputs.keys() & (set(made) - own))


def outputs_of(flow: Flow, records: Mapping[str, Record]) -> dict[str, FileDigests]:
    """List the digests of what results of a dataflow hold of the artefacts that their stages declare now."""
    return {
        artefact.name: records[stage.name].outputs[artefact.name]
        for stage in flow
        if stage.name in records
        for artefact in stage.gives
        if artefact.name in records[stage.name].outputs
    }


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


def outdated_summary(request: Request, store: Store) -> list[str]:
    """Describe files of the summary that tell of results before the present ones."""
    if request.flow[-1].name in consistent_results(request.flow, store):
        return []
    there = [name for name in request.summary_files if (request.workspace / "output" / name).is_file()]
    told, anew = ("they tell", "them") if len(there) > 1 else ("it tells", "it")
    which = f"{', '.join(there)} ({told} of all stages; a run of all of them makes {anew} anew)."
    return [f"Of an earlier run, in output: {which}"] if there else []


def _holds(path: Path, text: str) -> bool:
    """Check whether a file, not a link to one, has this text already."""
    there = path.is_file() and not path.is_symlink()
    return there and path.read_bytes() == text.encode("utf-8", "surrogateescape")
