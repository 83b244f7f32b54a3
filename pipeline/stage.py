"""Declaration of a stage: its name, version, settings, inputs and outputs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from pipeline.settings import Settings

if TYPE_CHECKING:
    from pipeline.job import Job

S = TypeVar("S", bound=Settings)


@dataclass(frozen=True)
class Artefact:
    """A named file or folder that a stage gives.

    Attributes
    ----------
    name : str
        Unique in the dataflow; other stages take it by this name.
    about : str
        Its content, one phrase.
    file : str or None
        File name inside the stage's result when it is one file; None for a folder called `name`.
    output : str or None
        Path below `output/` where its newest version is shown; None keeps it in the cache only.
    """

    name: str
    about: str
    file: str | None = None
    output: str | None = None

    @property
    def path(self) -> str:
        """Path inside the stage's result."""
        return self.file or self.name


def no_facts(settings: Settings) -> Mapping[str, str]:
    """Return no facts: the result is independent of the machine."""
    return {}


def unchanged(settings: S, memory: int) -> S:
    """Return the settings as they are: none of them bounds the memory."""
    return settings


def no_words(facts: Mapping[str, Any]) -> str:
    """Return no words: the stage has found nothing to tell."""
    return ""


def no_estimate(settings: Settings, inputs: Mapping[str, Path], threads: int) -> int | None:
    """Return no estimate: the stage's memory is not known before it runs."""
    return None


@dataclass(frozen=True)
class Stage(Generic[S]):
    """A step of the dataflow, declared.

    Attributes
    ----------
    name, version : str, int
        Identity; raise the version when the same inputs and settings would give another result.
    about : str
        One sentence for the guide's table of the dataflow and the page of settings.
    settings : type of Settings
    takes : tuple of str
        Artefacts or sources that it needs.
    may_take : tuple of str
        Sources that it uses when the user gives them.
    gives : tuple of Artefact
    run : callable
        The adapter: opens the inputs, calls the core, saves the outputs.
    ignores : tuple of str
        Settings, or phases of them, that this variant of the stage does not use: no part of the key.
    formerly : tuple of str
        Former names; a message for such a name states the present one.
    tools : tuple of str
        Distributions whose versions change the result: part of the key.
    machine : callable
        From the settings, the facts of this machine that change the result (say, which engine was chosen):
        part of the key. Must be quick.
    memory : callable
        From settings, the paths of its inputs and a number of threads, an estimate of the bytes that the
        stage will take; None where it is unknown. Must be quick beside the stage itself.
    within : callable
        From the settings and a number of bytes, the settings under which the stage needs no more memory than
        that, as far as they can bound it.
    saves_memory : str
        Settings that lower it, as the end of "For less memory, ".
    found : callable
        From the facts that it noted, what it has found, in a few words: "12 of 12 photos placed, 0.23 px".
    """

    name: str
    version: int
    about: str
    settings: type[S]
    takes: tuple[str, ...]
    gives: tuple[Artefact, ...]
    run: Callable[[Job[S]], None]
    may_take: tuple[str, ...] = ()
    ignores: tuple[str, ...] = ()
    formerly: tuple[str, ...] = ()
    tools: tuple[str, ...] = ()
    machine: Callable[[S], Mapping[str, str]] = field(default=no_facts)
    memory: Callable[[S, Mapping[str, Path], int], int | None] = field(default=no_estimate)
    within: Callable[[S, int], S] = field(default=unchanged)
    saves_memory: str = ""
    found: Callable[[Mapping[str, Any]], str] = field(default=no_words)


AnyStage = Stage[Any]  # a stage whose settings class is not stated: `settings_of` gives it
Flow = tuple[AnyStage, ...]


def former_names(flow: Iterable[AnyStage]) -> dict[str, str]:
    """Map former names of stages to present ones."""
    return {old: stage.name for stage in flow for old in stage.formerly}


def settings_of(stage: Stage[S], settings: Mapping[str, Settings]) -> S:
    """Look up a stage's own settings among those of all stages by name.

    Raises
    ------
    TypeError
        They are another stage's: a fault of the program.
    """
    own = settings[stage.name]
    if not isinstance(own, stage.settings):
        raise TypeError(f"{stage.name} takes {stage.settings.__name__}; got {type(own).__name__}")
    return own


@dataclass(frozen=True)
class Source:
    """An input that the user provides.

    Attributes
    ----------
    name : str
        Stages take it by this name.
    suffixes : tuple of str
        Suffixes of the files of a folder that are read; all files if empty.
    """

    name: str
    suffixes: tuple[str, ...] = ()
