"""Run what is not up to date: one stage after the other, each result published before the next begins."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.cache.output import Output
from pipeline.cache.record import Record
from pipeline.cache.store import Store
from pipeline.cluster.on_demand import ClusterOnDemand, clear_up_workers
from pipeline.errors import UserError
from pipeline.files.workspace_lock import locked
from pipeline.plan import Decision, decide, decide_all, read_sources
from pipeline.request import Request
from pipeline.run_stage import Listener, run_stage
from pipeline.stage import AnyStage
from pipeline.summary import consistent_results, outdated_summary, outputs_of, write_summary

__all__ = ["Done", "Listener", "clear_up", "run", "summarise"]


@dataclass(frozen=True)
class Done:
    """Outcome of one stage in a run."""

    decision: Decision
    record: Record

    def as_json(self) -> dict[str, Any]:
        """Convert to plain JSON values."""
        return self.decision.as_json() | {"key": self.record.key, "record": self.record.as_json()}


def run(request: Request, listener: Listener) -> list[Done]:
    """Bring the selected stages of a dataflow up to date; after the last of all, write the summary.

    Parameters
    ----------
    request : Request
    listener : Listener

    Returns
    -------
    list of Done
        Each stage up to the last selected one, with its decision and record.

    Raises
    ------
    UserError
        Another run holds the workspace; it cannot be written; a stage outside the selection is not up to
        date; a source changed while a stage read it, or cannot be fetched; or a stage found fault with its
        input. Results published before stay.
    MachineError
        A stage ran out of memory, or needs far more than there is.
    """
    with locked(request.workspace):
        store = Store(request.workspace)
        _clear_up(request, store)
        try:
            with _cluster(request) as cluster:
                return _run_in_order(request, store, listener, cluster)
        finally:
            store.memo.save()


def summarise(request: Request, listener: Listener) -> list[Path]:
    """Run the last stage alone on the current results of the others, and write the summary.

    The others need not be up to date, and no source is read. Returns the files of the summary.

    Raises
    ------
    UserError
        As `run`.
    """
    with locked(request.workspace):
        store = Store(request.workspace)
        _clear_up(request, store)
        try:
            available = outputs_of(request.flow, consistent_results(request.flow[:-1], store))
            with _cluster(request) as cluster:
                one = _bring_up_to_date(request.flow[-1], request, store, listener, cluster, available)
            _output(request, store).show(request.flow[-1], one.record)
            listener.finished(one.decision, one.record)
            return write_summary(request, store)
        finally:
            store.memo.save()


def clear_up(request: Request) -> list[str]:
    """Delete what a killed run left; returns the stages that it was in. What another run holds stays."""
    if (request.workspace / "cache").is_dir():
        with suppress(UserError, OSError), locked(request.workspace, patience_s=0):
            return _clear_up(request, Store(request.workspace))
    return []


def _clear_up(request: Request, store: Store) -> list[str]:
    clear_up_workers(request.workspace)
    _output(request, store).clear_up()
    return store.clear_up()


def _output(request: Request, store: Store) -> Output:
    return Output(request.workspace, store, [stage.name for stage in request.flow])


def _cluster(request: Request) -> ClusterOnDemand:
    tools = sorted({tool for stage in request.flow for tool in stage.tools})
    sources = tuple(request.sources.values())
    return ClusterOnDemand(request.cluster, request.threads, tools, request.workspace, sources, request.room)


def _run_in_order(request: Request, store: Store, listener: Listener, cluster: ClusterOnDemand) -> list[Done]:
    for sentence in request.remarks:
        listener.say(sentence)
    available = _read_sources_aloud(request, store, listener)
    store.memo.save()  # here and after each result: who interrupts a run would have all read again
    output = _output(request, store)
    flow = request.flow[: request.last_index() + 1]
    earlier = {stage.name: latest for stage in flow if (latest := store.latest(stage.name))}
    listener.planned(decide_all(request, store, available)[: len(flow)], earlier)
    done = []
    for stage in flow:
        one = _bring_up_to_date(stage, request, store, listener, cluster, available)
        output.show(stage, one.record)
        store.memo.save()
        available |= one.record.outputs
        listener.finished(one.decision, one.record)
        done.append(one)
    outdated = output.outdated(request.flow[len(done) :], available)
    if len(done) == len(request.flow):
        write_summary(request, store)
    else:
        outdated += outdated_summary(request, store)
    for sentence in outdated:
        listener.say(sentence)
    return done


def _bring_up_to_date(
    stage: AnyStage,
    request: Request,
    store: Store,
    listener: Listener,
    cluster: ClusterOnDemand,
    available: dict[str, Any],
) -> Done:
    """Reuse or run one stage, given the digests of what it may take."""
    decision = decide(stage, request, store, available)
    listener.deciding(decision)
    record = decision.record or run_stage(decision, request, store, listener, cluster)
    store.set_current(stage.name, record.key)
    return Done(decision, record)


def _read_sources_aloud(request: Request, store: Store, listener: Listener) -> dict[str, Any]:
    listener.begin("reading the sources", None)
    try:
        return read_sources(request, store, lambda name: listener.advance())
    finally:
        listener.end()
