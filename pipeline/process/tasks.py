"""Execution of a stage's tasks: on threads of this process, or on the workers of a Dask cluster.

A task is a picklable function of paths and settings. It reads and writes files, and returns little: where it
runs makes no difference.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

Item = TypeVar("Item")
Made = TypeVar("Made")


class Tasks(Protocol):
    """Runs tasks of a stage.

    Attributes
    ----------
    threads : int
        Threads that a large task may use; never changes its result.
    """

    @property
    def threads(self) -> int:
        """Threads of a large task."""

    def small(self, work: Callable[..., Made], items: Iterable[Item], *shared: Any) -> Iterator[Made]:
        """Run ``work(item, *shared)``, one thread each and many at a time; results in the items' order."""

    def large(
        self, work: Callable[..., Made], items: Iterable[Item], *shared: Any, at_a_time: int = 1
    ) -> Iterator[Made]:
        """Run the same, `threads` threads each; as many at a time as there are workers.

        `at_a_time`: on this machine, how many share the threads, while their memory is small.
        """


@dataclass(frozen=True)
class LocalTasks:
    """Tasks on the threads of this process; large ones one after the other."""

    executor: Executor
    threads: int

    def small(self, work: Callable[..., Made], items: Iterable[Item], *shared: Any) -> Iterator[Made]:
        """Run tasks on the executor's threads."""
        return self.executor.map(lambda item: work(item, *shared), items)

    def large(
        self, work: Callable[..., Made], items: Iterable[Item], *shared: Any, at_a_time: int = 1
    ) -> Iterator[Made]:
        """Run tasks one after the other, or some at a time, on all threads together."""
        if at_a_time == 1:
            yield from (work(item, *shared) for item in items)
            return
        with ThreadPoolExecutor(at_a_time) as executor:
            yield from executor.map(lambda item: work(item, *shared), items)
