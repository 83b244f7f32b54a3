"""The plan: per stage reuse or run, and the reason in one sentence."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any

from pipeline.cache.key import FileDigests, Ingredients, ingredients
from pipeline.cache.reasons import why_run
from pipeline.cache.record import Record
from pipeline.cache.store import Store
from pipeline.errors import UserError
from pipeline.request import Request
from pipeline.stage import AnyStage, Source, settings_of

Available = dict[str, FileDigests]
RecordOf = Callable[[str], Record | None]  # by the name of a stage
FORCED = "it was asked for with --force"
UNCHANGED = "nothing that it depends on has changed"


class Action(Enum):
    """The action planned for a stage."""

    REUSE = "reuse"
    RUN = "run"
    WAIT = "run or reuse"  # decided once the stages before it have run
    LEAVE = "leave"


@dataclass(frozen=True)
class ExpectedMemory:
    """Memory that a stage is expected to take: by its own estimate, or what its latest result took."""

    memory_bytes: int
    memory_from: str


@dataclass(frozen=True)
class Decision:
    """The action planned for one stage, and its reason.

    Attributes
    ----------
    stage : Stage
    action : Action
    reason : str
        One sentence without a full stop.
    made_from : Ingredients or None
        None while an input is not known yet.
    record : Record or None
        The result to reuse.
    memory : ExpectedMemory or None
        Of a stage that is not reused, in a plan; None where nothing is known of it.
    """

    stage: AnyStage
    action: Action
    reason: str
    made_from: Ingredients | None = None
    record: Record | None = None
    memory: ExpectedMemory | None = None

    def as_json(self) -> dict[str, Any]:
        """Convert to plain JSON values."""
        key = self.made_from.key if self.made_from else None
        told = {"stage": self.stage.name, "action": self.action.value, "reason": self.reason, "key": key}
        return told | (asdict(self.memory) if self.memory else {"memory_bytes": None, "memory_from": None})


def plan(request: Request, store: Store, sources: Available) -> list[Decision]:
    """Decide for every stage, without running any.

    Parameters
    ----------
    request : Request
    store : Store
    sources : dict
        Per source, the digests of its files (`read_sources`).
    """
    decisions = decide_all(request, store, sources)
    reused = {one.stage.name: one.record for one in decisions if one.record is not None}
    return [
        replace(one, memory=_expected_memory(one, request, store, reused.get))
        if one.action in (Action.RUN, Action.WAIT)
        else one
        for one in decisions
    ]


def decide_all(request: Request, store: Store, sources: Available) -> list[Decision]:
    """Decide for every stage as `plan` does, without an estimate of memory."""
    available: Available = dict(sources)
    decisions = []
    for stage in request.flow:
        decision = decide(stage, request, store, available)
        decisions.append(decision)
        if decision.record is not None:
            available |= decision.record.outputs
    return decisions


def _expected_memory(
    decision: Decision, request: Request, store: Store, record_of: RecordOf
) -> ExpectedMemory | None:
    """Estimate the memory of a stage whose inputs are there; of the others, look up the latest result's."""
    stage = decision.stage
    if decision.action is Action.RUN:
        inputs = located_inputs(stage, request, store, record_of)
        estimate = stage.memory(settings_of(stage, request.settings), inputs, request.threads)
        if estimate is not None:
            return ExpectedMemory(estimate, "an estimate")
    latest = store.latest(stage.name)
    if latest is None or not latest.peak_bytes:
        return None
    return ExpectedMemory(latest.peak_bytes, "the latest result")


def located_inputs(stage: AnyStage, request: Request, store: Store, record_of: RecordOf) -> dict[str, Path]:
    """Locate each input of a stage: a source, or an artefact of the result that an earlier stage has."""
    places = dict(request.sources)
    for earlier in request.flow[: request.flow.index(stage)]:
        record = record_of(earlier.name)
        if record is not None:
            entry = store.entry(earlier.name, record.key)
            places |= {artefact.name: entry / artefact.path for artefact in earlier.gives}
    return {name: places[name] for name in (*stage.takes, *stage.may_take) if name in places}


def decide(stage: AnyStage, request: Request, store: Store, available: Mapping[str, FileDigests]) -> Decision:
    """Decide for one stage, given what is available now."""
    position = request.flow.index(stage)
    if position > request.last_index():
        return Decision(stage, Action.LEAVE, f"it comes after {request.selected()[-1]}")
    unknown = [name for name in stage.takes if name not in available]
    if unknown:
        depends = f"depends on {_givers(unknown, request)}, which will run first"
        return Decision(stage, Action.WAIT, f"{FORCED}; {depends}" if _is_forced(stage, request) else depends)
    inputs = {name: available[name] for name in (*stage.takes, *stage.may_take) if name in available}
    made_from = ingredients(stage, settings_of(stage, request.settings), inputs)
    decision = _reuse_or_run(stage, made_from, request, store)
    absent = request.absent_from(stage)
    if not absent:
        return decision
    verb = "is known by its digests" if decision.action is Action.REUSE else "will be fetched"
    return replace(decision, reason=f"{decision.reason}; {' and '.join(absent)}, not on this machine, {verb}")


def _reuse_or_run(stage: AnyStage, made_from: Ingredients, request: Request, store: Store) -> Decision:
    if _is_forced(stage, request):
        return Decision(stage, Action.RUN, FORCED, made_from)
    record = store.record(stage.name, made_from.key)
    if record is None:
        return Decision(stage, Action.RUN, _why_without_record(made_from, store), made_from)
    damage = store.damage(stage, record)
    if damage is not None:
        return Decision(stage, Action.RUN, f"its cached result is damaged: {damage}", made_from)
    return Decision(stage, Action.REUSE, UNCHANGED, made_from, record)


def _is_forced(stage: AnyStage, request: Request) -> bool:
    return request.selection.force and stage.name in request.selected()


def _why_without_record(made_from: Ingredients, store: Store) -> str:
    """Explain a run where no result of this key can be used."""
    stage = made_from.stage
    if harm := store.damaged_record(stage, made_from.key):
        return f"its cached result is damaged: {harm}"
    before = store.latest(stage)
    if before is None and store.keys(stage):
        return "the records of its earlier results are missing or damaged"
    return why_run(made_from, before)


def _givers(artefacts: list[str], request: Request) -> str:
    """List the names of the stages that give these artefacts."""
    givers = [stage.name for stage in request.flow if {a.name for a in stage.gives} & set(artefacts)]
    return " and ".join(givers)


def read_sources(request: Request, store: Store, seen: Any = None) -> Available:
    """Compute digests of the files of every source that the dataflow takes; those of absent ones are known.

    Raises
    ------
    UserError
        A file or a folder of them cannot be read.
    """
    wanted = {name for stage in request.flow for name in (*stage.takes, *stage.may_take)}
    return {
        kind.name: (
            request.absent[kind.name].digests
            if kind.name in request.absent
            else _digests(kind, request.sources[kind.name], store, seen)
        )
        for kind in request.kinds
        if kind.name in wanted and kind.name in request.sources
    }


def _digests(kind: Source, path: Path, store: Store, seen: Any) -> FileDigests:
    """Compute digests of a source's files; a single file is listed under its kind, not under its own name."""
    try:
        digests = store.memo.tree(path, kind.suffixes, seen)
    except OSError as error:
        raise UserError(
            f"{error.filename or path}, of the source {kind.name}, cannot be read "
            f"({error.strerror or error}); expected files and folders that may be read. Change its "
            "permissions, or move it elsewhere."
        ) from error
    if path.is_file():
        (digest,) = digests.values()
        return {kind.name + path.suffix: digest}
    return digests
