"""The plan of a run in a few lines: what is reused together, what runs each with its reason."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from pipeline.cache.record import Record
from pipeline.command.durations import spent
from pipeline.plan import FORCED, UNCHANGED, Action, Decision


def plan_lines(decisions: Sequence[Decision], earlier: Mapping[str, Record]) -> Iterator[tuple[str, str]]:
    """List the lines of a plan: an action, and the stages that it is for."""
    reused = _of(decisions, Action.REUSE)
    for reason, own in _by_reason(reused).items():
        yield Action.REUSE.value, _names(own) if reason == UNCHANGED else f"{_names(own)}: {reason}"
    for decision in reused:
        if decision.record is not None and decision.record.warnings:
            number, name = len(decision.record.warnings), decision.stage.name
            yield "", f"{name} has {number} warning(s), see `unshade show … --stage {name}`"
    for reason, own in _by_reason(_of(decisions, Action.RUN)).items():
        yield Action.RUN.value, f"{_names(own)}: {reason}"
    for when, waiting in _by_certainty(_of(decisions, Action.WAIT), earlier).items():
        if waiting:
            yield "then", f"{_names(waiting)}: {when}"
    if (seconds := expected_seconds(decisions, earlier)) is not None:
        yield "", f"This took {spent(seconds)} earlier."


def _by_certainty(waiting: Sequence[Decision], earlier: Mapping[str, Record]) -> dict[str, list[Decision]]:
    """Sort stages that wait for others by whether they run in any case."""
    forced = [one for one in waiting if one.reason.startswith(FORCED)]
    others = [one for one in waiting if not one.reason.startswith(FORCED)]
    return {
        FORCED: forced,
        "for the first time": [one for one in others if one.stage.name not in earlier],
        "unless what they take comes out as before": [one for one in others if one.stage.name in earlier],
    }


def expected_seconds(decisions: Sequence[Decision], earlier: Mapping[str, Record]) -> float | None:
    """Sum the seconds of the latest results of the stages that run, or may; None where one has none."""
    names = [one.stage.name for one in decisions if one.action in (Action.RUN, Action.WAIT)]
    if not names or any(name not in earlier for name in names):
        return None
    return sum(earlier[name].seconds for name in names)


def _of(decisions: Sequence[Decision], action: Action) -> list[Decision]:
    return [one for one in decisions if one.action is action]


def _by_reason(decisions: Sequence[Decision]) -> dict[str, list[Decision]]:
    reasons = dict.fromkeys(one.reason for one in decisions)
    return {reason: [one for one in decisions if one.reason == reason] for reason in reasons}


def _names(decisions: Sequence[Decision]) -> str:
    return ", ".join(one.stage.name for one in decisions)
