"""Time of a method from its start, without the evaluations of its energy."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Lock


class OutOfTime(Exception):  # noqa: N818 — no error: the budget is how every rival ends
    """A method has used up its time."""


class Clock:
    """A stop-watch that can be paused.

    Parameters
    ----------
    budget_s : float
    workers : int
        Threads that share the work; a pause of one counts by its share of them, since evaluations of
        the energy are spread over them as the work is.
    """

    def __init__(self, budget_s: float, workers: int = 1):
        self._budget_s, self._workers, self._lock = budget_s, workers, Lock()
        self._started, self._held_s = time.perf_counter(), 0.0

    @property
    def seconds(self) -> float:
        """Seconds so far, without pauses."""
        return time.perf_counter() - self._started - self._held_s

    def check(self, *_: object) -> None:
        """Check the budget; to be called often, as callback of solvers, whose arguments are ignored.

        Raises
        ------
        OutOfTime
            The budget is used up.
        """
        if self.seconds > self._budget_s:
            raise OutOfTime

    @contextmanager
    def held(self) -> Iterator[None]:
        """Pause the clock during a block."""
        before = time.perf_counter()
        try:
            yield
        finally:
            with self._lock:
                self._held_s += (time.perf_counter() - before) / self._workers


@dataclass(frozen=True)
class Look:
    """The energy of all channels together, in the gauge, at a time."""

    seconds: float
    energy: float


@dataclass(frozen=True)
class Trace:
    """Course of one method on one problem.

    Attributes
    ----------
    method : str
    looks : tuple of Look
        In the order of time.
    """

    method: str
    looks: tuple[Look, ...]

    @property
    def least(self) -> float:
        """Least energy observed."""
        return min(look.energy for look in self.looks)

    def seconds_to(self, energy: float) -> float | None:
        """Find the time when the energy was first this low; None if it never was."""
        return next((look.seconds for look in self.looks if look.energy <= energy), None)
