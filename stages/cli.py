"""The `unshade` command: where the machinery and the craft meet."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

import tyro
from tyro.conf import FlagCreatePairsOff

from pipeline import MachineError, UserError
from pipeline.cache.key import tool_version
from pipeline.command import verbs
from pipeline.command.streams import prepare_process
from pipeline.command.terminal import Terminal, output_stream
from pipeline.files.file_kinds import is_folder
from pipeline.process.child import DIES_WITH_PARENT
from pipeline.process.forked import in_fork
from pipeline.process.memory_limits import is_out_of_memory
from pipeline.request import Request
from stages import IN_ORDER
from stages.command.arguments import (
    Clean,
    Command,
    Compare,
    Diff,
    Doctor,
    Evaluate,
    Plan,
    Relight,
    Report,
    Run,
    Show,
    Status,
    refuse_empty,
)
from stages.command.compare import compare_verb
from stages.command.doctor import doctor_verb
from stages.command.evaluation import evaluate_verb
from stages.command.overview import asks_for_help, overview
from stages.command.report import report_verb
from stages.command.request import relighting_of, reporting_of, request_of
from stages.command.sources import check_lights
from stages.command.workspaces import existing_workspace

COMMANDS = [kind.__name__.lower() for kind in get_args(Command)]
SHARED = ("numba", "scipy.ndimage", "cv2", "OpenEXR")  # a second and 100 MB; open3d is for few stages
USER_MISTAKE, FAULT, INTERRUPTED = 2, 1, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Parse, do, and answer with an exit code: 0 done, 2 something the user can put right, 1 our fault.

    As a program (without `argv`) it also sets up its process, and computes in a child of it.
    """
    # BLAS splits its sums by the number of cores: on one thread the bits are the same on every machine, and
    # the stages are parallel over views, rows or channels anyway. Read when numpy is first imported.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    if argv is None:
        prepare_process()
    words = list(sys.argv[1:] if argv is None else argv)
    terminal = Terminal("--json" in words, ["unshade", *words])
    return exit_code_of(lambda: parse_and_obey(words, terminal, in_child=argv is None), terminal)


def parse_and_obey(words: Sequence[str], terminal: Terminal, in_child: bool) -> int:
    """Parse a command line and do what it says; returns the exit code."""
    command = None
    with output_stream() as stream:
        if words == ["--version"]:
            stream.write(f"unshade {tool_version('unshade')}\n")
        elif asks_for_help(words):
            stream.write(overview())
        else:
            refuse_empty(words)
            refuse_path_for_a_command(words)
            command = tyro.cli(Command, args=words, prog="unshade", config=(FlagCreatePairsOff,))
    return obey(command, terminal, in_child) if command else 0


def exit_code_of(work: Callable[[], int | None], terminal: Terminal) -> int:
    """Do some work, print the error that it raises, and return the exit code: its own, if it returns one."""
    try:
        return work() or 0
    except UserError as error:
        terminal.fail(str(error))
        return USER_MISTAKE
    except KeyboardInterrupt:
        kept = f" What was finished is kept. {verbs.how_to_go_on(terminal.words)}"
        terminal.fail(f"Interrupted.{kept if terminal.words[:1] in (('run',), ('relight',)) else ''}")
        return INTERRUPTED
    except MachineError as error:
        terminal.fail(str(error))
        return FAULT
    except Exception as error:
        if is_out_of_memory(error):
            terminal.fail(
                "The memory is full; expected room for more. End other programs; earlier results are kept."
            )
        else:
            terminal.fault(error)
        return FAULT


def refuse_path_for_a_command(words: Sequence[str]) -> None:
    """Say which command takes the path that was given in place of one.

    Raises
    ------
    UserError
        The first word is a folder or a configuration.
    """
    if not words or words[0].startswith("-") or words[0] in COMMANDS:
        return
    given = Path(words[0])
    if is_folder(given):
        raise UserError(f"{given} is a folder, and no command. For photos: `unshade run --images {given}`.")
    if given.suffix.lower() in (".yaml", ".yml"):
        raise UserError(f"{given} is a configuration, and no command. To run it: `unshade run {given}`.")


def obey(command: Command, terminal: Terminal, in_child: bool) -> int:
    """Do what a parsed command says; returns the exit code of what was done in a child process."""
    match command:
        case Plan():
            check_lights((request := request_of(command)).sources)
            verbs.plan_verb(request, terminal)
        case Run():
            return carry_out(request_of(command), terminal, in_child)
        case Relight():
            return carry_out(relighting_of(command), terminal, in_child)
        case Report():
            request = reporting_of(command)
            return in_process(lambda: report_verb(request, terminal), request, terminal, in_child)
        case Status():
            verbs.status_verb(existing_workspace(command), [stage.name for stage in IN_ORDER], terminal)
        case Show():
            verbs.show_verb(existing_workspace(command), command.stage, command.key, terminal)
        case Diff():
            verbs.diff_verb(existing_workspace(command), command.stage, command.keys or (), terminal)
        case Clean():
            verbs.clean_verb(existing_workspace(command), command.everything, terminal)
        case Evaluate():
            evaluate_verb(command, terminal)
        case Compare():
            compare_verb(command, terminal)
        case Doctor():
            return doctor_verb(command, terminal)
    return 0


def carry_out(request: Request, terminal: Terminal, in_child: bool) -> int:
    """Run the stages of a request, in child processes or in this one."""
    forks = in_child and DIES_WITH_PARENT  # else a stage would go on where its run was ended

    def work() -> None:
        if forks:  # libraries that read lights begin threads, which the forks of stages would miss
            in_fork(lambda _: check_lights(request.sources), lambda: None)
        else:
            check_lights(request.sources)
        verbs.run_verb(replace(request, forks=forks, shared_imports=SHARED), terminal)

    return in_process(work, request, terminal, in_child)


def in_process(work: Callable[[], None], request: Request, terminal: Terminal, in_child: bool) -> int:
    """Do the work of a request, in a child process or in this one; returns the exit code."""
    if in_child:
        return verbs.do_in_child(lambda: exit_code_of(work, terminal), request, terminal)
    work()
    return 0


if __name__ == "__main__":
    sys.exit(main())
