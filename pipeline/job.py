"""The arguments with which a stage runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from pipeline.cluster.tasks import LocalTasks, Tasks
from pipeline.settings import Settings

Made = TypeVar("Made")
S_co = TypeVar("S_co", bound=Settings, covariant=True)  # a function for any stage's job takes Job[Settings]


class Progress(Protocol):
    """Display of progress; the command line implements it."""

    def begin(self, label: str, total: int | None, at_most: bool = False) -> None:
        """Begin a task of `total` steps (None: unknown), or of so many at most."""

    def advance(self, steps: int = 1) -> None:
        """Advance by `steps`."""

    def end(self) -> None:
        """End the task."""


class Silence:
    """Progress that is not displayed: for benchmarks and tests that run one stage alone."""

    def begin(self, label: str, total: int | None, at_most: bool = False) -> None:
        """Do nothing."""

    def advance(self, steps: int = 1) -> None:
        """Do nothing."""

    def end(self) -> None:
        """Do nothing."""


def counted(results: Iterable[Made], step: Callable[..., None]) -> Iterator[Made]:
    """Iterate over results, and advance a task's progress by one for each."""
    for one in results:
        step()
        yield one


@dataclass(frozen=True)
class Job(Generic[S_co]):
    """One run of one stage: settings, paths of inputs and outputs, threads, progress and messages.

    Attributes
    ----------
    settings : Settings
        The stage's own settings, validated.
    inputs : mapping of str to Path
        Path of every artefact and source it takes; optional sources that were not given are absent.
    outputs : mapping of str to Path
        Path at which to write each artefact; folders exist already.
    scratch : Path
        A private folder that is deleted afterwards.
    threads : int
        Threads to use; never changes the result.
    executor : Executor
        Threads of this process, for what reads into its memory or writes from it.
    machine : mapping of str to str
        Result of `Stage.machine`: the choices that this machine imposes.
    cluster : Tasks or None
        Workers elsewhere, if there are any.
    """

    settings: S_co
    inputs: Mapping[str, Path]
    outputs: Mapping[str, Path]
    scratch: Path
    threads: int
    executor: Executor
    shown: Progress
    say: Callable[[str], None]
    machine: Mapping[str, str] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    cluster: Tasks | None = None

    @property
    def tasks(self) -> Tasks:
        """Where picklable functions of paths and settings run: elsewhere, or on threads of this process."""
        return self.cluster or LocalTasks(self.executor, self.threads)

    @contextmanager
    def progress(
        self, label: str, total: int | None = None, at_most: bool = False
    ) -> Iterator[Callable[..., None]]:
        """Show the progress of a task: ``with job.progress("depth maps", n) as step: … step()``.

        `at_most`: the steps may be fewer, as those of a minimisation that converges.
        """
        self.shown.begin(label, total, at_most)
        try:
            yield self.shown.advance
        finally:
            self.shown.end()

    def note(self, **facts: Any) -> None:
        """Keep facts (JSON values) in the record: counts, residuals, coverage."""
        self.facts.update(facts)

    def warn(self, sentence: str) -> None:
        """Warn the user of something that changes the meaning of the result; kept in the record."""
        self.warnings.append(sentence)
        self.say(sentence)
