"""Spans of a stage: the tasks whose progress it showed, and how long each took."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from pipeline.job import Progress


@dataclass
class Span:
    """One task of a stage.

    Attributes
    ----------
    label : str
    total : int or None
        Steps that were announced.
    steps : int
        Steps that were made.
    begun_s, seconds : float
        When it began, since the stage did, and how long it took: so far, if it is at work.
    at_most : bool
        The steps may be fewer than `total`.
    """

    label: str
    total: int | None
    steps: int = 0
    begun_s: float = 0.0
    seconds: float = 0.0
    at_most: bool = False

    @property
    def end_s(self) -> float:
        """When it ended, since the stage began."""
        return self.begun_s + self.seconds


@dataclass(frozen=True)
class Moment:
    """A moment of a stage at work.

    Attributes
    ----------
    elapsed_s : float
        Since the stage began.
    spans : tuple of Span
        Those begun so far, in order.
    at_work : bool
        The last span has not ended.
    idle_s : float
        Since the last step was made, or since a span began or ended.
    """

    elapsed_s: float
    spans: tuple[Span, ...]
    at_work: bool
    idle_s: float


@dataclass
class TimedProgress:
    """Progress that is passed on, and timed. Tasks within tasks count as part of the outer one."""

    shown: Progress
    clock: Callable[[], float] = time.perf_counter
    spans: list[Span] = field(default_factory=list)
    _depth: int = 0

    def __post_init__(self) -> None:
        """Begin now."""
        self.restart()

    def restart(self) -> None:
        """Count times from now on."""
        self._begun = self._last = self.clock()

    def begin(self, label: str, total: int | None, at_most: bool = False) -> None:
        """Begin a task."""
        if self._depth == 0:
            whole = None if total is None else int(total)
            self.spans.append(Span(label, whole, begun_s=self._now(), at_most=at_most))
        self._depth += 1
        self.shown.begin(label, total, at_most)

    def advance(self, steps: int = 1) -> None:
        """Count steps of the outer task."""
        if self._depth == 1:
            self.spans[-1].steps += steps
            self._now()
        self.shown.advance(steps)

    def end(self) -> None:
        """End a task."""
        self._depth -= 1
        if self._depth == 0:
            self.spans[-1].seconds = self._now() - self.spans[-1].begun_s
        self.shown.end()

    def moment(self) -> Moment:
        """Describe this moment."""
        now, at_work = self.clock(), self._depth > 0
        elapsed = now - self._begun
        spans = list(self.spans)
        if at_work and spans:
            spans[-1] = replace(spans[-1], seconds=elapsed - spans[-1].begun_s)
        return Moment(elapsed, tuple(spans), at_work, now - self._last)

    def _now(self) -> float:
        """Read the seconds since the beginning, and remember that something happened."""
        self._last = self.clock()
        return self._last - self._begun
