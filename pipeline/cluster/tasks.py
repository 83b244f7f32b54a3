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
    """Execution of tasks; results come in the order of the items."""

    def small(self, work: Callable[..., Made], items: Iterable[Item], *shared: Any) -> Iterator[Made]:
        """Run ``work(item, *shared)`` on one thread each, many at a time."""

    def large(
        self, work: Callable[..., Made], items: Iterable[Item], *shared: Any, at_a_time: int = 1
    ) -> Iterator[Made]:
        """Run ``work(item, *shared, threads)``, which may use so many threads; no result depends on them.

        Workers elsewhere run one each. In this process, so many as `at_a_time` share the threads.
        """


@dataclass(frozen=True)
class LocalTasks:
    """Tasks on the threads of this process."""

    executor: Executor
    threads: int

    def small(self, work: Callable[..., Made], items: Iterable[Item], *shared: Any) -> Iterator[Made]:
        """Run tasks on the executor's threads."""
        return self.executor.map(lambda item: work(item, *shared), items)

    def large(
        self, work: Callable[..., Made], items: Iterable[Item], *shared: Any, at_a_time: int = 1
    ) -> Iterator[Made]:
        """Run tasks one after the other, or some at a time, on all threads together."""
        at_a_time = min(at_a_time, self.threads)
        if at_a_time == 1:
            yield from (work(item, *shared, self.threads) for item in items)
            return
        each = self.threads // at_a_time
        with ThreadPoolExecutor(at_a_time) as executor:
            yield from executor.map(lambda item: work(item, *shared, each), items)
