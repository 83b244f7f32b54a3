"""The work of a stage: its job, in a process of its own or in this one, measured."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from pipeline.cache.key import Ingredients
from pipeline.cluster.dask_tasks import DaskTasks
from pipeline.job import Job, Progress
from pipeline.process.forked import in_fork
from pipeline.process.logbook import logged
from pipeline.process.memory_limits import compare_with_allowed_memory, gigabytes, memory_errors_told
from pipeline.process.meter import Reading, measured
from pipeline.process.spans import Span, TimedProgress
from pipeline.process.temporary_files import temporary_files_in
from pipeline.request import Request
from pipeline.settings import Settings
from pipeline.stage import AnyStage, settings_of


class Shown(Progress, Protocol):
    """Receiver of a stage's progress and sentences."""

    def say(self, sentence: str) -> None:
        """Report a sentence to the user."""


@dataclass(frozen=True)
class Places:
    """Where a stage reads and writes: as in its job, and its log."""

    inputs: Mapping[str, Path]
    outputs: Mapping[str, Path]
    scratch: Path
    log: Path


@dataclass(frozen=True)
class Work:
    """What a stage leaves beside its files: facts and warnings, what it cost, and its spans."""

    facts: dict[str, Any]
    warnings: Sequence[str]
    reading: Reading
    spans: Sequence[Span]


def do_work(
    stage: AnyStage,
    made_from: Ingredients,
    places: Places,
    request: Request,
    shown: Shown,
    cluster: DaskTasks | None,
) -> Work:
    """Do the work of a stage: in a fork, if the request says so and no threads to a cluster are needed.

    Raises what the stage does, and `MachineError` where memory was lacking.
    """
    if not request.forks or cluster is not None:
        return _work(stage, made_from, places, request, shown, cluster)
    with memory_errors_told(stage):
        for name in request.shared_imports:
            import_module(name)
    return in_fork(
        lambda tell: _work(stage, made_from, places, request, _Told(tell), None),
        lambda event, *values: getattr(shown, event)(*values),
    )


class _Told:
    """Progress and sentences of a stage in a fork, told to the process that shows them."""

    def __init__(self, tell: Callable[..., None]) -> None:
        self._tell = tell

    def begin(self, label: str, total: int | None, at_most: bool = False) -> None:
        """Tell that a task begins."""
        self._tell("begin", label, total, at_most)

    def advance(self, steps: int = 1) -> None:
        """Tell of steps."""
        self._tell("advance", steps)

    def end(self) -> None:
        """Tell that the task has ended."""
        self._tell("end")

    def say(self, sentence: str) -> None:
        """Tell a sentence."""
        self._tell("say", sentence)


def _work(
    stage: AnyStage,
    made_from: Ingredients,
    places: Places,
    request: Request,
    shown: Shown,
    cluster: DaskTasks | None,
) -> Work:
    """Do the work of a stage in this process."""
    with _threads(request.threads) as executor:
        timed = TimedProgress(shown)
        job = Job(
            settings=settings_of(stage, request.settings),
            inputs=places.inputs,
            outputs=places.outputs,
            scratch=places.scratch,
            threads=request.threads,
            executor=executor,
            shown=timed,
            say=shown.say,
            machine=made_from.machine,
            cluster=cluster,
        )
        with (
            memory_errors_told(stage),
            logged(stage, job, places.log, request.workspace / "logs"),
            temporary_files_in(job.scratch),
            measured() as reading,
        ):
            timed.restart()  # as `reading` does
            needed = compare_with_allowed_memory(stage, job, request.memory)
            stage.run(job if cluster is None else on_workers(job, cluster.with_room(needed)))
    return Work(job.facts, tuple(job.warnings), reading, tuple(timed.spans))


def on_workers(job: Job[Settings], tasks: DaskTasks) -> Job[Settings]:
    """Give a job its workers, and say where not all of them have room."""
    if tasks.at_once is not None:
        job.say(
            f"{tasks.at_once} of {tasks.local} workers at a time solve what takes much memory: "
            f"together they have {gigabytes(tasks.room or 0)}."
        )
    return replace(job, cluster=tasks)


@contextmanager
def _threads(number: int) -> Iterator[Executor]:
    """Provide threads for one stage; when it fails, running work is awaited and queued work dropped."""
    executor = ThreadPoolExecutor(number)
    try:
        yield executor
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
