"""What a stage is handed when it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from pipeline.settings import Settings

S_co = TypeVar("S_co", bound=Settings, covariant=True)  # what takes any stage's job takes a Job[Settings]


class Progress(Protocol):
    """Where progress is shown; the command line decides how."""

    def begin(self, label: str, total: int | None) -> None:
        """A new piece of work of `total` steps (None: unknown)."""

    def advance(self, steps: int = 1) -> None:
        """`steps` more are done."""

    def end(self) -> None:
        """The piece of work is over."""


class Silence:
    """Progress that is shown to nobody: for benchmarks and tests that run one stage by hand."""

    def begin(self, label: str, total: int | None) -> None:
        """Nothing."""

    def advance(self, steps: int = 1) -> None:
        """Nothing."""

    def end(self) -> None:
        """Nothing."""


@dataclass(frozen=True)
class Job(Generic[S_co]):
    """One run of one stage: where its inputs lie, where its outputs go, and whom to tell.

    Attributes
    ----------
    settings : Settings
        The stage's own settings, validated.
    inputs : mapping of str to Path
        Every artefact and source it takes; optional sources that were not given are absent.
    outputs : mapping of str to Path
        Where to write each artefact; folders exist already.
    scratch : Path
        A private folder that is deleted afterwards.
    threads : int
        Threads to use; never changes the result.
    executor : Executor
        Threads for per-view work, in functions that may run side by side.
    machine : mapping of str to str
        What `Stage.machine` said: the choices that this machine imposes.
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

    @contextmanager
    def progress(self, label: str, total: int | None = None) -> Iterator[Callable[..., None]]:
        """Show a piece of work: ``with job.progress("depth maps", n) as step: … step()``."""
        self.shown.begin(label, total)
        try:
            yield self.shown.advance
        finally:
            self.shown.end()

    def note(self, **facts: Any) -> None:
        """Keep facts (JSON values) in the record: counts, residuals, coverage."""
        self.facts.update(facts)

    def warn(self, sentence: str) -> None:
        """Tell the user something that changes what the result means; kept in the record."""
        self.warnings.append(sentence)
        self.say(sentence)
