"""A user's request: a dataflow, its settings, the sources, the workspace, and which stages may run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.cache.record import Record
from pipeline.cluster.on_demand import ClusterRequest
from pipeline.errors import UserError
from pipeline.settings import Settings, near
from pipeline.stage import AnyStage, Flow, Source, former_names


@dataclass(frozen=True)
class Selection:
    """Which stages may run.

    Attributes
    ----------
    only, first, last : str or None
        One stage alone; the first and the last of a range. Stages outside must be up to date already.
    force : bool
        Run the selected stages even where they are up to date.
    """

    only: str | None = None
    first: str | None = None
    last: str | None = None
    force: bool = False

    def bounds(self) -> str:
        """Format the range as options of the command line; empty without one."""
        given = {"--from": self.first, "--to": self.last}
        return " ".join(f"{flag} {name}" for flag, name in given.items() if name is not None)


@dataclass(frozen=True)
class Absent:
    """A source that is not on this machine though its content is known: a published data set.

    Its digests still prove results that were made from it; only a stage that reads it needs the files.

    Attributes
    ----------
    digests : mapping of str to str
        Digest of each of its files by relative path.
    fetch : callable
        Bring verified files to the path of the source, or raise a `UserError`.
    """

    digests: Mapping[str, str]
    fetch: Callable[[], None]


@dataclass(frozen=True)
class Result:
    """A result in the cache: its record, and the folder of its artefacts."""

    record: Record
    folder: Path


Summary = Callable[[Mapping[str, Result]], Mapping[str, str]]  # texts by file name, from results by stage


@dataclass(frozen=True)
class Pointer:
    """A place to open after a run.

    Attributes
    ----------
    stage : str
        After a run of which it is up to date.
    path : str
        Below `output/`.
    about : str
        Its content, a few words.
    """

    stage: str
    path: str
    about: str


@dataclass(frozen=True)
class Request:
    """A dataflow with all that it needs to be planned and run.

    Attributes
    ----------
    flow : tuple of Stage
        In order: a stage takes sources and artefacts of earlier stages.
    settings : mapping of str to Settings
        Per stage name.
    sources : mapping of str to Path
        Paths of the user's inputs, by source name.
    kinds : tuple of Source
        Declarations of all sources.
    workspace : Path
    threads : int
        Never changes a result.
    memory : int or None
        Bytes that a stage may take, and each worker elsewhere; None: what is free.
    room : int or None
        Bytes into which stages divide their work, and which local workers share; None: not known.
    cluster : ClusterRequest or None
        Where the tasks of stages run; None: on threads of the stage's process.
    forks : bool
        Each stage has a process of its own, whose memory is free after it, where no cluster is wanted. For a
        program that has not begun any threads; off, all is done in this process.
    shared_imports : tuple of str
        Modules that most stages import: once then, before the first fork. They begin no threads.
    absent : mapping of str to Absent
        Those of the sources whose files are fetched only if a stage reads them.
    remarks : tuple of str
        Sentences on what was chosen for the user, said before anything is planned or run.
    summary : callable or None
        Makes files of `output/` from the results of all stages, by stage: at the end of a whole run.
    summary_files : tuple of str
        Names of those files.
    pointers : tuple of Pointer
        What a run that has ended leads its user to, where it is there, in order.
    """

    flow: Flow
    settings: Mapping[str, Settings]
    sources: Mapping[str, Path]
    kinds: tuple[Source, ...]
    workspace: Path
    threads: int = 1
    memory: int | None = None
    room: int | None = None
    cluster: ClusterRequest | None = None
    forks: bool = False
    shared_imports: tuple[str, ...] = ()
    selection: Selection = field(default_factory=Selection)
    absent: Mapping[str, Absent] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    summary: Summary | None = None
    summary_files: tuple[str, ...] = ()
    pointers: tuple[Pointer, ...] = ()

    def absent_from(self, stage: AnyStage) -> list[str]:
        """List the names of the absent sources that a stage takes."""
        return [name for name in (*stage.takes, *stage.may_take) if name in self.absent]

    def selected(self) -> tuple[str, ...]:
        """List the names of the stages that may run.

        Raises
        ------
        UserError
            A name is not that of a stage of this dataflow, the range is empty, or one stage and a range
            were asked for.
        """
        names = [stage.name for stage in self.flow]
        chosen = self.selection
        for name in (chosen.only, chosen.first, chosen.last):
            if name is not None and name not in names:
                hint = near(name, names, former_names(self.flow))
                raise UserError(f"There is no stage {name!r} in this dataflow; {hint}")
        if chosen.only is not None:
            if bounds := chosen.bounds():
                raise UserError(
                    f"--only {chosen.only} and {bounds} were given; expected one stage alone or a range. "
                    "Leave out one."
                )
            return (chosen.only,)
        begin = names.index(chosen.first) if chosen.first else 0
        end = names.index(chosen.last) if chosen.last else len(names) - 1
        if end < begin:
            raise UserError(
                f"--from {chosen.first} comes after --to {chosen.last}; expected a range in the order "
                f"{', '.join(names)}."
            )
        return tuple(names[begin : end + 1])

    def last_index(self) -> int:
        """Find the position of the last selected stage; later stages do not run."""
        return [stage.name for stage in self.flow].index(self.selected()[-1])


def check_flow(flow: Flow, kinds: tuple[Source, ...]) -> None:
    """Refuse a dataflow in which a stage takes what no earlier stage gives, or two give the same.

    Raises
    ------
    ValueError
        The declarations contradict each other: a fault of the program, not of its user.
    """
    known = {source.name for source in kinds}
    for stage in flow:
        missing = [name for name in (*stage.takes, *stage.may_take) if name not in known]
        if missing:
            raise ValueError(f"{stage.name} takes {missing}, which no source or earlier stage gives")
        for artefact in stage.gives:
            if artefact.name in known:
                raise ValueError(f"{stage.name} gives {artefact.name}, which is there already")
            known.add(artefact.name)
