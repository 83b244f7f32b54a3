"""Time that counts: from a method's start, without what is spent on looking at its energy."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Lock


class OutOfTime(Exception):  # noqa: N818 — no error: the budget is how every rival ends
    """A method has used up its time."""


class Clock:
    """A stop-watch that can be held.

    Parameters
    ----------
    budget_s : float
    workers : int
        Threads that share the work; each one's pause counts as its share of them, since looking at
        energies is spread over them as the work is.
    """

    def __init__(self, budget_s: float, workers: int = 1):
        self._budget_s, self._workers, self._lock = budget_s, workers, Lock()
        self._started, self._held_s = time.perf_counter(), 0.0

    @property
    def seconds(self) -> float:
        """Time that counts so far."""
        return time.perf_counter() - self._started - self._held_s

    def check(self, *_: object) -> None:
        """To be called often; takes and ignores what solvers pass to their callbacks.

        Raises
        ------
        OutOfTime
            The budget is used up.
        """
        if self.seconds > self._budget_s:
            raise OutOfTime

    @contextmanager
    def held(self) -> Iterator[None]:
        """What is done inside does not count."""
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
    """What one method did to one problem.

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
        """The least energy seen."""
        return min(look.energy for look in self.looks)

    def seconds_to(self, energy: float) -> float | None:
        """When the energy was first this low; None if it never was."""
        return next((look.seconds for look in self.looks if look.energy <= energy), None)
