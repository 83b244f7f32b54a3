"""Time that a stage at work still takes: from its progress, and from what it took earlier in this workspace.

An earlier result is a timetable: when each task of the stage began, how many steps it made, how long they
took. The progress of now has a place in it, and the time spent so far against that place is the pace.
Without an earlier result only the task at work can be estimated, not the stage. Nothing is said where nothing
is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.cache.record import Record
from pipeline.process.spans import Moment, Span

FIRM = 0.2  # share of the earlier time by which an expected pace counts against the measured one
SOONEST_S, FEWEST_STEPS = 1.0, 3  # before these, the steps made say nothing of the next ones


@dataclass(frozen=True)
class TimeLeft:
    """An estimate.

    Attributes
    ----------
    seconds : float
        At least 0.
    share : float
        Part that is done, 0 to 1, of the stage or the task.
    of_task : bool
        It is that of the task at work alone: what else the stage has to do is not known.
    at_most : bool
        It may be less, since the task may need fewer steps.
    """

    seconds: float
    share: float
    of_task: bool = False
    at_most: bool = False


def time_left(moment: Moment, earlier: Record | None) -> TimeLeft | None:
    """Estimate the time that a stage still takes; None where nothing is known of it."""
    if earlier is not None and (left := _by_timetable(moment, earlier)) is not None:
        seconds = max(left, 0.0)
        return TimeLeft(seconds, moment.elapsed_s / max(moment.elapsed_s + seconds, 1e-9))
    return _of_task(moment)


@dataclass(frozen=True)
class _Place:
    """Where the last event of a stage stands in the earlier timetable.

    Attributes
    ----------
    at_s, next_s : float
        Earlier seconds of that event, and of the next one.
    work : float
        Steps that its task has now, over those that it had then.
    """

    at_s: float
    next_s: float
    work: float = 1.0


def _by_timetable(moment: Moment, earlier: Record) -> float | None:
    """Estimate by an earlier result; None where the moment has no place in it, or is beyond its end."""
    last = _place(moment, earlier)
    if last is None:
        return None
    firm = FIRM * earlier.seconds
    before = max(moment.elapsed_s - moment.idle_s, 0.0)
    place = min(last.at_s + moment.idle_s / _pace(before, last.at_s, firm, last.work), last.next_s)
    if place >= earlier.seconds:
        return None
    return (earlier.seconds - place) * _pace(moment.elapsed_s, place, firm, last.work)


def _pace(now_s: float, then_s: float, firm_s: float, expected: float) -> float:
    """Divide seconds of now by those of then, drawn to what is expected by a weight in seconds."""
    return max((now_s + firm_s * expected) / max(then_s + firm_s, 1e-9), 1e-9)


def _place(moment: Moment, earlier: Record) -> _Place | None:
    """Find the last event of a moment in the timetable; None where its task was not there then."""
    spans = [Span(**one) for one in earlier.spans]
    if not spans:  # nothing was noted then but the whole: as fast as then
        return _Place(max(moment.elapsed_s - moment.idle_s, 0.0), earlier.seconds)
    if not moment.spans:
        return _Place(0.0, spans[0].begun_s)
    same = _earlier_span(moment.spans, spans)
    if same is None:
        return None
    now = moment.spans[-1]
    work = now.total / same.total if now.total and same.total else 1.0
    if not moment.at_work:
        later = [one.begun_s for one in spans if one.begun_s >= same.end_s]
        return _Place(same.end_s, min(later, default=earlier.seconds), work)
    steps = same.steps * work
    if steps <= 0:
        return _Place(same.begun_s, same.end_s, work)
    at, after = (same.begun_s + min(made / steps, 1.0) * same.seconds for made in (now.steps, now.steps + 1))
    return _Place(at, after, work)


def _earlier_span(spans: Sequence[Span], earlier: Sequence[Span]) -> Span | None:
    """Find the span of an earlier run that corresponds to the last one of now: the same task as often."""
    if not spans:
        return None
    same = [one for one in earlier if one.label == spans[-1].label]
    number = sum(one.label == spans[-1].label for one in spans)
    return same[number - 1] if number <= len(same) else None


def _of_task(moment: Moment) -> TimeLeft | None:
    """Estimate by the steps of the task at work alone."""
    if not moment.at_work or not moment.spans:
        return None
    task = moment.spans[-1]
    if not task.total or task.steps < FEWEST_STEPS or task.seconds < SOONEST_S:
        return None
    seconds = _seconds_of_steps(task, moment.idle_s)
    share = min(task.steps / task.total, 1.0)
    return None if seconds is None else TimeLeft(seconds, share, of_task=True, at_most=task.at_most)


def _seconds_of_steps(task: Span, idle_s: float) -> float | None:
    """Extrapolate the steps made; a step that takes longer than they did raises the estimate.

    None where that step is the last one.
    """
    to_do = max((task.total or 0) - task.steps, 0)
    usual_s = max(task.seconds - idle_s, 0.0) / task.steps
    if idle_s <= usual_s:
        return usual_s * to_do - idle_s if to_do else 0.0
    return task.seconds / (task.steps + 1) * (to_do - 1) if to_do > 1 else None
