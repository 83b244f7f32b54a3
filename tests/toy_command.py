"""A program that runs the toy dataflow as `unshade run` does, with a stage that takes its time and shows it.

``python -m tests.toy_command ROOT [--json] [--force] [--slow SECONDS]``
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

from pipeline.command.terminal import Terminal
from pipeline.command.verbs import do_in_child, run_verb
from pipeline.job import Job
from pipeline.request import Pointer, Request
from tests import toy_flow

LETTERS = 4
POINTERS = (
    Pointer("report", "page.txt", "the page"),
    Pointer("count", "numbers", "the counts"),
    Pointer("count", "absent.txt", "what is not there"),
)


def request(root: Path, seconds: float = 0.0, **selection) -> Request:
    """The toy's request, whose `count` takes that long."""

    def count(job: Job) -> None:
        with job.progress("letters", LETTERS) as step:
            for _ in range(LETTERS):
                time.sleep(seconds / LETTERS)
                step()
        job.note(letters=LETTERS)
        toy_flow.count(job)

    flow = (
        replace(toy_flow.JOIN, found=lambda facts: f"{facts['words']} words"),
        replace(toy_flow.COUNT, run=count, found=lambda facts: f"{facts['letters']} letters"),
        toy_flow.REPORT,
    )
    return replace(toy_flow.request(root, flow=flow, **selection), forks=True, pointers=POINTERS)


def main(words: list[str]) -> int:
    """Run it; returns the exit code."""
    seconds = float(words[words.index("--slow") + 1]) if "--slow" in words else 0.0
    terminal = Terminal("--json" in words, ["unshade", "run", *words])
    wishes = request(Path(words[0]), seconds, force="--force" in words)

    def work() -> int:
        run_verb(wishes, terminal)
        return 0

    return do_in_child(work, wishes, terminal)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
