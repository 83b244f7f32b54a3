"""The `unshade` command: where the machinery and the craft meet."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction, arg

import stages
from pipeline import UserError, verbs
from pipeline.config import Config, check_settings, override, read_config
from pipeline.request import Request, Selection, check_flow
from pipeline.terminal import Terminal
from stages.scene.datasets import dataset_folder

USER_MISTAKE, FAULT, INTERRUPTED = 2, 1, 130
SOURCE_OF_FLAG = {"images": "images", "colmap": "colmap", "mesh": "mesh_file", "masks": "masks"}
DATASET_PHOTOS = "images"
ABOUT = "Per-view albedo from photos or a COLMAP workspace: the light and the shading apart."


def optional(metavar: str, name: str | None = None) -> Any:
    """How the help shows an option that need not be given."""
    return arg(metavar=metavar, name=name, help_behavior_hint="")


Folder = Annotated[Path | None, optional("DIR")]
File = Annotated[Path | None, optional("FILE")]
StageName = Annotated[str | None, optional("STAGE")]


@dataclass(frozen=True)
class Given:
    """Where things are.

    Attributes
    ----------
    config
        YAML configuration; without it the defaults are good for a folder of photos.
    workspace
        Folder for the cache and the output; by default the configuration's, else `workspaces/NAME-OF-PHOTOS`.
    images
        Folder of photos.
    colmap
        Folder with a COLMAP model: its cameras are taken instead of running structure from motion.
    mesh
        Mesh in the frame of that model: taken instead of dense stereo and reconstruction.
    masks
        Folder of masks named like the photos, white = keep.
    assignments
        A setting, as in `--set decomposition.lambda=2`; repeatable.
    threads
        Processor threads; by default all. Never changes a result.
    json
        Answer in JSON on the output stream.
    """

    config: Annotated[Positional[Path | None], optional("[CONFIG]")] = None
    workspace: Folder = None
    images: Folder = None
    colmap: Folder = None
    mesh: File = None
    masks: Folder = None
    assignments: Annotated[UseAppendAction[tuple[str, ...]], optional("STAGE.SETTING=VALUE", "set")] = ()
    threads: Annotated[int | None, optional("N")] = None
    json: bool = False


@dataclass(frozen=True)
class Run(Given):
    """Bring everything that is not up to date up to date.

    Attributes
    ----------
    only
        Run this stage alone; the ones before it must be up to date.
    first
        Run this stage and those after it; the ones before it must be up to date.
    last
        Stop after this stage.
    force
        Run the selected stages even where they are up to date.
    """

    only: StageName = None
    first: Annotated[str | None, optional("STAGE", "from")] = None
    last: Annotated[str | None, optional("STAGE", "to")] = None
    force: bool = False


@dataclass(frozen=True)
class Plan(Run):
    """Per stage: reuse or run, and the reason in one sentence. Takes what `run` takes, runs nothing."""


@dataclass(frozen=True)
class Status(Given):
    """What the workspace holds, and what it cost."""


@dataclass(frozen=True)
class Show(Given):
    """The record of a stage's newest result.

    Attributes
    ----------
    stage
        Which stage.
    key
        Beginning of a result's key, for another than the newest.
    """

    stage: str = "decomposition"
    key: Annotated[str | None, optional("KEY")] = None


@dataclass(frozen=True)
class Diff(Given):
    """What differs between two results of a stage.

    Attributes
    ----------
    stage
        Which stage.
    keys
        Beginnings of two keys; by default the newest result and the one before.
    """

    stage: str = "decomposition"
    keys: Annotated[tuple[str, str] | None, optional("KEY KEY")] = None


@dataclass(frozen=True)
class Clean(Given):
    """Delete results that are no longer current.

    Attributes
    ----------
    everything
        Delete the current ones too; `output/` stays.
    """

    everything: bool = False


Command = Run | Plan | Status | Show | Diff | Clean


def main(argv: Sequence[str] | None = None) -> int:
    """Parse, do, and answer with an exit code: 0 done, 2 something the user can put right, 1 our fault."""
    # BLAS splits its sums by the number of cores: on one thread the bits are the same on every machine, and
    # the stages are parallel over views, rows or channels anyway. Read when numpy is first imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    words = list(sys.argv[1:] if argv is None else argv)
    command = tyro.cli(Command, args=words, prog="unshade", description=ABOUT, config=(FlagCreatePairsOff,))
    terminal = Terminal(command.json)
    try:
        obey(command, terminal)
    except UserError as error:
        terminal.fail(str(error))
        return USER_MISTAKE
    except KeyboardInterrupt:
        terminal.fail("Interrupted. What was finished is kept; the next run continues there.")
        return INTERRUPTED
    except Exception as error:
        traceback.print_exc()
        terminal.fail(
            f"{type(error).__name__}: {error}. This is a fault of unshade; earlier results are kept."
        )
        return FAULT
    return 0


def obey(command: Command, terminal: Terminal) -> None:
    """Do what a parsed command says."""
    match command:
        case Plan():
            verbs.plan_verb(request_of(command), terminal)
        case Run():
            verbs.run_verb(request_of(command), terminal)
        case Status():
            verbs.status_verb(existing_workspace(command), terminal)
        case Show():
            verbs.show_verb(existing_workspace(command), command.stage, command.key, terminal)
        case Diff():
            verbs.diff_verb(existing_workspace(command), command.stage, command.keys or (), terminal)
        case Clean():
            verbs.clean_verb(existing_workspace(command), command.everything, terminal)


def request_of(command: Run) -> Request:
    """Turn a command into a checked request.

    Raises
    ------
    UserError
        Anything about it that the user should put right.
    """
    config = config_of(command)
    sources = sources_of(command, config)
    flow = stages.dataflow(sources)
    check_flow(flow, stages.SOURCES)
    declared = {stage.name: stage.settings for stage in stages.ALL_STAGES}
    return Request(
        flow=flow,
        settings=check_settings(declared, override(config.settings, command.assignments)),
        sources=sources,
        kinds=stages.SOURCES,
        workspace=workspace_of(command, config, sources),
        threads=threads_of(command),
        selection=Selection(command.only, command.first, command.last, command.force),
    )


def config_of(command: Given) -> Config:
    """The configuration file's content, or an empty configuration."""
    if command.config is None:
        return Config()
    names = [stage.name for stage in stages.ALL_STAGES]
    return read_config(command.config, [*SOURCE_OF_FLAG, "dataset"], names)


def sources_of(command: Given, config: Config) -> dict[str, Path]:
    """Every source that was given, on the command line before the configuration, and exists."""
    sources = {}
    if "dataset" in config.sources and command.images is None:
        sources["images"] = dataset_folder(config.sources["dataset"]) / DATASET_PHOTOS
    for flag, name in SOURCE_OF_FLAG.items():
        given = getattr(command, flag)
        if given is None and flag in config.sources:
            given = beside(config, config.sources[flag])
        if given is not None:
            sources[name] = existing(flag, given)
    if "colmap" in sources and "images" not in sources and (sources["colmap"] / "images").is_dir():
        sources["images"] = sources["colmap"] / "images"
    return sources


def beside(config: Config, path: str) -> Path:
    """A path that a configuration names, relative to its folder."""
    return Path(os.path.normpath(config.folder / path))


def existing(flag: str, path: Path) -> Path:
    """The path, if it is there and of the right kind."""
    expected = "file" if flag == "mesh" else "folder"
    if not path.exists():
        raise UserError(f"--{flag} {path} does not exist; expected a {expected}. Check the path.")
    if path.is_dir() != (expected == "folder"):
        raise UserError(f"--{flag} {path} is not a {expected}; expected a {expected}.")
    return path


def workspace_of(command: Given, config: Config, sources: dict[str, Path]) -> Path:
    """The workspace that was asked for, or `workspaces/` and the name of the photo folder's project."""
    if command.workspace is not None:
        return command.workspace
    if config.workspace is not None:
        return beside(config, config.workspace)
    photos = sources["images"].resolve()
    return Path("workspaces", photos.parent.name if photos.name == "images" else photos.name)


def existing_workspace(command: Given) -> Path:
    """The workspace that a verb looks at.

    Raises
    ------
    UserError
        None was named, or it is not there.
    """
    config = config_of(command)
    if command.workspace is None and config.workspace is None:
        raise UserError("No workspace was named; expected a configuration, or --workspace DIR.")
    workspace = workspace_of(command, config, {})
    if not (workspace / "cache").is_dir():
        raise UserError(f"{workspace} holds no results yet; `unshade run` makes them, or check the path.")
    return workspace


def threads_of(command: Given) -> int:
    """Threads to use: what was asked for, else all that this process may use.

    Raises
    ------
    UserError
        Fewer than one was asked for.
    """
    if command.threads is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if command.threads < 1:
        raise UserError(f"--threads is {command.threads}; expected 1 or more.")
    return command.threads


if __name__ == "__main__":
    sys.exit(main())
