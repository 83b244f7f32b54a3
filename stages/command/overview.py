"""`unshade --help`: what the program is for, how to begin, and its commands, on one screen."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import get_args

from stages.command.arguments import Command

HEAD = """\
Unshade takes photos, or a COLMAP workspace, and separates the albedo of what
they show from light and shading. Begin with one of these:

  unshade run --images photos/                       photos alone
  unshade run --images photos/ --colmap project/     with COLMAP's cameras
  unshade run configs/sample.yaml                    what a configuration says
  unshade run --images photos/ --texture             a textured model, besides

"""
TAIL = """
What a command takes: unshade run --help. Version: unshade --version.
Inputs and reruns: docs/guide.md. Every setting: docs/settings.md.
"""


def asks_for_help(words: Sequence[str]) -> bool:
    """Check for a command line that asks for help on no command in particular."""
    return list(words) in ([], ["-h"], ["--help"], ["help"])


def overview() -> str:
    """Write the help: a line per command, the first sentence of its description."""
    lines = [f"  {kind.__name__.lower():<10}{_in_one_line(kind)}" for kind in get_args(Command)]
    return HEAD + "\n".join(lines) + "\n" + TAIL


def _in_one_line(kind: type) -> str:
    first = (inspect.getdoc(kind) or "").partition("\n")[0]
    return first.partition(". ")[0].partition("; ")[0].rstrip(".") + "."
