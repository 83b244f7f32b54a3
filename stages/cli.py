"""The `unshade` command: where the machinery and the craft meet."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

import tyro
from tyro.conf import FlagCreatePairsOff

from pipeline import UserError, verbs
from pipeline.file_kinds import is_folder
from pipeline.key import tool_version
from pipeline.terminal import Terminal
from stages import IN_ORDER
from stages.command.arguments import Clean, Command, Diff, Evaluate, Plan, Relight, Run, Show, Status
from stages.command.evaluation import evaluate_verb
from stages.command.request import existing_workspace, relighting_of, request_of

COMMANDS = [kind.__name__.lower() for kind in (Run, Plan, Relight, Status, Show, Diff, Clean, Evaluate)]
USER_MISTAKE, FAULT, INTERRUPTED = 2, 1, 130
ABOUT = (
    "Per-view albedo from photos or a COLMAP workspace: the light and the shading apart. "
    "`unshade --version` says which unshade this is."
)


def main(argv: Sequence[str] | None = None) -> int:
    """Parse, do, and answer with an exit code: 0 done, 2 something the user can put right, 1 our fault."""
    # BLAS splits its sums by the number of cores: on one thread the bits are the same on every machine, and
    # the stages are parallel over views, rows or channels anyway. Read when numpy is first imported.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    words = list(sys.argv[1:] if argv is None else argv)
    if words == ["--version"]:
        sys.stdout.write(f"unshade {tool_version('unshade')}\n")
        return 0
    if hint := path_for_a_command(words):
        Terminal().fail(hint)
        return USER_MISTAKE
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


def path_for_a_command(words: Sequence[str]) -> str:
    """Say which command takes the path that was given in place of one; empty where there is a command."""
    if not words or words[0].startswith("-") or words[0] in COMMANDS:
        return ""
    given = Path(words[0])
    if is_folder(given):
        return f"{given} is a folder, and no command. For photos: `unshade run --images {given}`."
    if given.suffix.lower() in (".yaml", ".yml"):
        return f"{given} is a configuration, and no command. To run it: `unshade run {given}`."
    return ""


def obey(command: Command, terminal: Terminal) -> None:
    """Do what a parsed command says."""
    match command:
        case Plan():
            verbs.plan_verb(request_of(command), terminal)
        case Run():
            verbs.run_verb(request_of(command), terminal)
        case Relight():
            verbs.run_verb(relighting_of(command), terminal)
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


if __name__ == "__main__":
    sys.exit(main())
