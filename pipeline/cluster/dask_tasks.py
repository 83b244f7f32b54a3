"""Execution of a stage's tasks on the workers of a Dask cluster."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

from pipeline.errors import MachineError

if TYPE_CHECKING:
    from distributed import Client, Worker

Item = TypeVar("Item")
Made = TypeVar("Made")
BETWEEN_LOOKS_S = 0.05  # at workers that finish their last tasks


@dataclass(frozen=True)
class DaskTasks:
    """Tasks on the workers of a cluster. Those of a lost worker are done again by others.

    Attributes
    ----------
    client : Client
    threads : int
        Of a large task.
    local : int or None
        Workers of one task each that share this machine; None: they are elsewhere.
    room : int or None
        Memory that local workers share, bytes.
    at_once : int or None
        Large tasks at a time, where fewer have room than there are local workers; None: as many as these.
    """

    client: Client
    threads: int
    local: int | None = None
    room: int | None = None
    at_once: int | None = None

    def with_room(self, needed: int | None) -> DaskTasks:
        """Run only as many large tasks at once as local workers have room for; they share all threads.

        `needed`: bytes that each takes; None: not known.
        """
        if self.local is None or self.room is None or not needed or self.local * needed <= self.room:
            return self
        at_once = max(1, self.room // needed)
        return replace(self, threads=self.threads * self.local // at_once, at_once=at_once)

    def small(self, work: Callable[..., Made], items: Iterable[Item], *shared: Any) -> Iterator[Made]:
        """Run tasks on the workers, as many at a time as they have threads."""
        return self._in_order(work, items, shared, None)

    def large(
        self, work: Callable[..., Made], items: Iterable[Item], *shared: Any, at_a_time: int = 1
    ) -> Iterator[Made]:
        """Run tasks on the workers, as many at a time as they have threads, or room."""
        return self._in_order(work, items, (*shared, self.threads), self.at_once)

    def _in_order(
        self, work: Callable[..., Made], items: Iterable[Item], shared: Sequence[Any], at_once: int | None
    ) -> Iterator[Made]:
        """Run tasks, so many at once; the oldest is awaited before a further one begins."""
        with _losses_told():
            # As tasks of their own, they are sent once, and again where the worker that held them is lost.
            common = [self.client.submit(_same, one, pure=False) for one in shared]
            self.client.replicate(common)  # else few tasks queue on the one worker that has them
            futures = deque[Any]()
            try:
                for item in items:
                    if len(futures) == at_once:
                        yield futures.popleft().result()  # which need not be kept
                    futures.append(self.client.submit(work, item, *common, pure=False))
                while futures:
                    yield futures.popleft().result()
            except Exception:
                self._await_running(list(futures))
                raise
            finally:
                self.client.cancel(list(futures))

    def _await_running(self, futures: list[Any]) -> None:
        """Cancel what has not begun, and wait for what has: it may still write into the stage's folder."""
        if self.client.status != "running":
            return
        keys = {future.key for future in futures}
        self.client.cancel(futures)
        while any(self.client.run(_is_running, keys, on_error="ignore").values()):
            time.sleep(BETWEEN_LOOKS_S)


def _same(value: Made) -> Made:
    return value


def _is_running(keys: set[str], dask_worker: Worker) -> bool:
    """Check, on a worker, whether one of the tasks occupies a thread."""
    return any(task.key in keys for task in dask_worker.state.all_running_tasks)


@contextmanager
def _losses_told() -> Iterator[None]:
    """Turn the loss of workers or of the scheduler into a sentence.

    Raises
    ------
    MachineError
        A task ended several workers, or the scheduler is gone.
    """
    from distributed import KilledWorker
    from distributed.comm import CommClosedError

    try:
        yield
    except KilledWorker as error:
        raise MachineError(
            f"A task ended several workers one after the other ({error}); expected workers that survive "
            "it. Most likely their memory was full: take fewer workers, or less memory with --memory. "
            "Earlier results are kept."
        ) from error
    except (CancelledError, CommClosedError) as error:
        raise MachineError(
            f"The connection to the scheduler was lost ({error}); expected one that runs until the end. "
            "Start it and its workers again, and repeat the command: earlier results are kept."
        ) from error
