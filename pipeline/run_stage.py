"""Run one stage: its checks before and after, its record, its publication."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Protocol

from pipeline.cache.key import Ingredients
from pipeline.cache.reasons import changed_files
from pipeline.cache.record import Record
from pipeline.cache.store import Store
from pipeline.cluster.on_demand import ClusterOnDemand
from pipeline.errors import UserError
from pipeline.plan import Decision, located_inputs, read_sources
from pipeline.process.spans import Span
from pipeline.request import Request
from pipeline.stage import AnyStage
from pipeline.stage_work import Places, Shown, Work, do_work


class Listener(Shown, Protocol):
    """Receiver of a run's events, such as the command line."""

    def planned(self, decisions: Sequence[Decision], earlier: Mapping[str, Record]) -> None:
        """Report the plan of a run, and the latest results of its stages, by which it may be timed."""

    def deciding(self, decision: Decision) -> None:
        """Report that a stage is about to be reused or run."""

    def finished(self, decision: Decision, record: Record) -> None:
        """Report that a stage's result is available."""


def run_stage(
    decision: Decision, request: Request, store: Store, listener: Listener, cluster: ClusterOnDemand
) -> Record:
    """Run one stage and publish its result."""
    stage, made_from = decision.stage, decision.made_from
    if stage.name not in request.selected():
        raise UserError(
            f"{request.selected()[0]} needs an up-to-date {stage.name}, but {decision.reason}. "
            f"Run once with --to {stage.name}, or without choosing stages."
        )
    if made_from is None:
        raise RuntimeError(f"{stage.name} was to run though {decision.reason}")
    _fetch_absent_sources(stage, request, listener)
    partial = store.begin(stage.name)
    with _kept_only_if_finished(partial):
        places = _places(stage, made_from, request, store, partial)
        try:
            left = do_work(stage, made_from, places, request, listener, cluster.tasks())
        except Exception:
            _check_inputs(stage, places, made_from, request, store)  # an input that is gone says more
            raise
        _check_inputs(stage, places, made_from, request, store)
        shutil.rmtree(places.scratch)
        record = _record(stage, made_from, places, left, store)
        _compare_with_twin(store, record, listener)
        store.publish(partial, record)
    return record


def _fetch_absent_sources(stage: AnyStage, request: Request, listener: Listener) -> None:
    """Fetch the files of the sources that a stage is about to read.

    Raises
    ------
    UserError
        They cannot be had.
    """
    for name in request.absent_from(stage):
        listener.begin(f"fetching {name}", None)
        try:
            request.absent[name].fetch()
        finally:
            listener.end()


@contextmanager
def _kept_only_if_finished(partial: Path) -> Iterator[None]:
    """Remove what a stage that failed leaves.

    Raises
    ------
    UserError
        It failed, and its folder is gone: somebody else removed it.
    """
    try:
        yield
    except Exception as error:
        if partial.is_dir():
            raise
        raise UserError(
            f"{partial} was deleted while a stage wrote its result there; expected a cache that is left "
            "alone during a run. Run again: earlier results that are still there are reused."
        ) from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)  # published means renamed: then there is nothing here


def _places(stage: AnyStage, made_from: Ingredients, request: Request, store: Store, partial: Path) -> Places:
    """Locate the inputs of a stage, and create its output folders.

    Raises
    ------
    UserError
        An input that was there when the stage was decided on is gone.
    """
    inputs = located_inputs(stage, request, store, store.current)
    if gone := sorted(made_from.inputs.keys() - inputs.keys()):
        raise UserError(
            f"The result with {', '.join(gone)}, which {stage.name} takes, was deleted from the cache during "
            "the run; expected a cache that is left alone. Run again, and it is made anew."
        )
    outputs = {artefact.name: partial / artefact.path for artefact in stage.gives}
    for artefact in stage.gives:
        if artefact.file is None:
            outputs[artefact.name].mkdir()
    scratch = partial / "scratch"
    scratch.mkdir()
    return Places(inputs, outputs, scratch, partial / "log.txt")


def _check_inputs(
    stage: AnyStage, places: Places, made_from: Ingredients, request: Request, store: Store
) -> None:
    """Refuse a result whose inputs changed since the run began: its key has their earlier digests.

    Raises
    ------
    UserError
        Files of a source or of a cached artefact were added, removed or changed, or the folder in which the
        stage works is gone.
    """
    found = read_sources(replace(request, flow=(stage,), absent={}), store)
    cached = [name for name in made_from.inputs if name not in request.sources]
    found |= {name: store.digests(places.inputs[name]) for name in cached}
    for name, files in found.items():
        before = made_from.inputs[name]
        if files != before:
            kind = "cached artefact" if name in cached else "source"
            raise UserError(
                f"The {kind} {name} changed during the run ({changed_files(files, before)}), so that what "
                f"{stage.name} made of it was dropped; expected files that stay as they are. Earlier results "
                "are kept: run again."
            )
    if not places.scratch.is_dir():
        raise UserError(
            f"{places.scratch}, where {stage.name} worked, was deleted during the run; expected a cache that "
            "is left alone. Earlier results are kept as far as they are there: run again."
        )


def _record(stage: AnyStage, made_from: Ingredients, places: Places, left: Work, store: Store) -> Record:
    """Build the record of a finished stage.

    Raises
    ------
    RuntimeError
        The stage did not write what it declares: a fault of the program.
    """
    missing = [name for name, path in places.outputs.items() if not path.exists()]
    if missing:
        raise RuntimeError(f"{stage.name} ended without writing {', '.join(missing)}")
    return Record(
        stage=stage.name,
        version=stage.version,
        key=made_from.key,
        settings=made_from.settings,
        inputs=made_from.inputs,
        tools=made_from.tools,
        machine=made_from.machine,
        outputs={name: store.digests(path) for name, path in places.outputs.items()},
        facts=left.facts,
        warnings=tuple(left.warnings),
        finished=datetime.now(timezone.utc).isoformat(timespec="microseconds"),
        seconds=left.reading.seconds,
        cpu_seconds=left.reading.cpu_seconds,
        peak_bytes=left.reading.peak_bytes,
        spans=tuple(map(_rounded, left.spans)),
    )


def _rounded(span: Span) -> dict[str, Any]:
    """Convert to plain JSON values, times in milliseconds."""
    return asdict(span) | {"begun_s": round(span.begun_s, 3), "seconds": round(span.seconds, 3)}


def _compare_with_twin(store: Store, record: Record, listener: Listener) -> None:
    """Compare with an earlier result of the same key, and report outputs that differ."""
    twin = store.record(record.stage, record.key)
    if twin is None:
        return
    changed = [name for name in record.outputs if record.outputs[name] != twin.outputs.get(name)]
    if changed:
        listener.say(f"{record.stage}: {', '.join(changed)} came out different from the same ingredients.")
