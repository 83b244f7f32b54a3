"""The time left: it comes true where nothing changes, follows the pace, and is never invented."""

from __future__ import annotations

from dataclasses import asdict, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline import Silence
from pipeline.cache.record import Record
from pipeline.command.bar import Bar
from pipeline.command.durations import about
from pipeline.command.time_left import TimeLeft, time_left
from pipeline.process.spans import Moment, Span, TimedProgress

STEPS = [
    Span("features", 10, 10, 1.0, 20.0),
    Span("pairs", 40, 40, 22.0, 60.0),
    Span("adjusting", None, 0, 83.0, 15.0),
]


def recorded(spans=STEPS, seconds: float = 100.0) -> Record:
    empty = {name: {} for name in ("settings", "inputs", "tools", "machine", "outputs")}
    return Record("sfm", 1, "key", **empty, seconds=seconds, spans=tuple(map(asdict, spans)))


def replayed(at_s: float, slower: float = 1.0, work: float = 1.0, spans=STEPS) -> Moment:
    """The moment `at_s` of a run whose steps take so many times as long as earlier, or are so many."""
    factor, begun = slower * work, []
    for span in spans:
        begin, seconds = factor * span.begun_s, factor * span.seconds
        if begin > at_s:
            break
        total = None if span.total is None else round(span.total * work)
        made = min(at_s - begin, seconds)
        steps = int(made / seconds * total) if total else 0
        begun.append(Span(span.label, total, steps, begin, made))
    last = begun[-1] if begun else None
    at_work = last is not None and at_s < last.begun_s + factor * spans[len(begun) - 1].seconds
    since = 0.0 if last is None else last.begun_s
    if last is not None and at_work and last.total:
        since += last.steps * factor * spans[len(begun) - 1].seconds / last.total
    elif last is not None and not at_work:
        since = last.end_s
    return Moment(at_s, tuple(begun), at_work, at_s - since)


@pytest.mark.parametrize("at_s", [0.5, 3, 10, 21.5, 30, 60, 81, 82.5, 90, 97])
def test_a_run_like_the_earlier_one_ends_when_it_is_said_to(at_s):
    left = time_left(replayed(at_s), recorded())
    assert left is not None and not left.of_task
    assert left.seconds == pytest.approx(100 - at_s, abs=1.5)
    assert left.share == pytest.approx(at_s / 100, abs=0.02)


@pytest.mark.parametrize(("at_s", "within"), [(60, 0.35), (120, 0.25), (180, 0.2)])
def test_a_slower_run_is_noticed_as_it_goes(at_s, within):
    left = time_left(replayed(at_s, slower=2), recorded())
    assert left is not None
    assert left.seconds == pytest.approx(200 - at_s, rel=within)


def test_twice_as_many_steps_are_expected_to_take_twice_as_long_before_any_is_made():
    moment = Moment(1.0, (Span("features", 20, 0, 1.0, 0.0),), True, 0.0)
    usual = time_left(Moment(1.0, (Span("features", 10, 0, 1.0, 0.0),), True, 0.0), recorded())
    double = time_left(moment, recorded())
    assert usual is not None and double is not None
    assert double.seconds == pytest.approx(2 * usual.seconds, rel=0.1)


def test_a_task_that_recurs_has_the_place_of_its_own_time():
    spans = [Span("rays", 10, 10, 0.0, 10.0), Span("rays", 10, 10, 10.0, 30.0)]
    second = (spans[0], Span("rays", 10, 5, 10.0, 15.0))
    left = time_left(Moment(25.0, second, True, 0.0), recorded(spans, 40.0))
    assert left is not None and left.seconds == pytest.approx(15)


def test_without_an_earlier_run_only_the_task_at_work_is_timed():
    moment = Moment(15.0, (Span("pairs", 20, 5, 5.0, 10.0),), True, 0.0)
    left = time_left(moment, None)
    assert left == TimeLeft(pytest.approx(30.0), 0.25, of_task=True)
    assert "pairs 5/20: about 30 s  0:15" in Bar("sfm", moment, left).line(80).plain
    at_most = replace(moment, spans=(replace(moment.spans[0], at_most=True),))
    assert "pairs 5/20: at most 30 s" in Bar("sfm", at_most, time_left(at_most, None)).line(80).plain


def test_a_step_that_takes_longer_than_those_before_raises_the_estimate():
    moments = [Moment(5 + s, (Span("pairs", 10, 5, 0.0, 5.0 + s),), True, s) for s in (0.0, 1.0, 7.0, 25.0)]
    estimates = [left.seconds for moment in moments if (left := time_left(moment, None))]
    assert estimates == pytest.approx([5, 4, 8, 20])
    last_step = Moment(20.0, (Span("pairs", 10, 9, 0.0, 20.0),), True, 11.0)
    assert time_left(last_step, None) is None


@pytest.mark.parametrize(
    "moment",
    [
        Moment(50.0, (), False, 50.0),
        Moment(50.0, (Span("adjusting", None, 0, 10.0, 40.0),), True, 40.0),
        Moment(50.0, (Span("pairs", 10, 0, 10.0, 40.0),), True, 40.0),
        Moment(50.0, (Span("pairs", 10, 10, 10.0, 30.0),), False, 10.0),
    ],
)
def test_nothing_is_said_where_nothing_is_known(moment):
    assert time_left(moment, None) is None
    assert "left" not in Bar("sfm", moment).line(80).plain and "0:50" in Bar("sfm", moment).line(80).plain


def test_a_stage_that_takes_longer_than_ever_is_not_promised_an_end():
    assert time_left(Moment(130.0, tuple(STEPS), False, 32.0), recorded()) is None
    old = replace(recorded(), spans=())  # of a version that did not time tasks
    assert time_left(Moment(130.0, (), False, 130.0), old) is None
    halfway = time_left(Moment(50.0, (), False, 50.0), old)
    assert halfway is not None and halfway.seconds == pytest.approx(50)
    reporting = time_left(Moment(50.0, (Span("rays", 193, 88, 1.0, 49.0),), True, 0.1), old)
    assert reporting is not None and reporting.seconds == pytest.approx(50, abs=0.2)


SPANS = st.builds(
    Span,
    label=st.sampled_from(["a", "b"]),
    total=st.none() | st.integers(0, 50),
    steps=st.integers(0, 60),
    begun_s=st.floats(0, 100),
    seconds=st.floats(0, 100),
)
MOMENTS = st.builds(
    Moment, st.floats(0, 1e5), st.lists(SPANS, max_size=3).map(tuple), st.booleans(), st.floats(0, 1e5)
)


@given(
    MOMENTS,
    st.none() | st.builds(recorded, st.lists(SPANS, max_size=3), st.floats(0, 1e4)),
    st.integers(1, 200),
)
def test_no_estimate_is_negative_and_no_line_is_too_long(moment, earlier, columns):
    left = time_left(moment, earlier)
    if left is not None:
        assert left.seconds >= 0 and 0 <= left.share <= 1
    assert Bar("decomposition", moment, left, 12.0).line(columns).cell_len <= max(columns - 1, 1)


def test_a_bar_loses_what_matters_least_first():
    moment = Moment(21.0, (Span("pairs", 20, 5, 5.0, 16.0),), True, 0.0)
    bar = Bar("lighting", moment, TimeLeft(100.0, 0.25), 300.0)
    lines = {columns: bar.line(columns, ascii_only=True).plain for columns in (100, 60, 46, 34, 12)}
    assert lines == {
        100: f"lighting  {'#' * 8}{'-' * 22}  pairs 5/20  0:21, about 2 min left, about 7 min in all",
        60: "lighting  ###----------  pairs 5/20  0:21, about 2 min left",
        46: "lighting  pairs 5/20  0:21, about 2 min left",
        34: "lighting  0:21, about 2 min left",
        12: "lighting  0",
    }


def test_progress_is_timed_by_its_outer_tasks():
    now = iter([0.0, 1.0, 2.0, 3.0, 5.0, 6.0, 8.0, 9.0])
    timed = TimedProgress(Silence(), clock=lambda: next(now))
    timed.begin("views", 4)
    timed.advance(2)
    timed.begin("rays", 9)
    timed.advance()
    timed.end()
    timed.advance()
    timed.end()
    assert timed.spans == [Span("views", 4, 3, 1.0, 4.0)]
    assert timed.moment() == Moment(6.0, (Span("views", 4, 3, 1.0, 4.0),), False, 1.0)


def test_times_are_said_no_more_exactly_than_they_are_known():
    assert [about(seconds) for seconds in (0, 30.2, 89, 91, 3000, 4000)] == [
        "a few s",
        "about 30 s",
        "about 90 s",
        "about 2 min",
        "about 50 min",
        "about 1 h 10 min",
    ]
