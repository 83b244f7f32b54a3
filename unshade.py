"""The program `unshade`: loads the command, which takes a second, so that Ctrl-C ends that in a line, too."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import NoReturn

INTERRUPTED = 128 + signal.SIGINT


def main() -> int:
    """Load the command and do what it says; returns the exit code, see `stages.cli.main`."""
    as_before = signal.getsignal(signal.SIGINT)
    if as_before is not signal.SIG_IGN:  # as it is for jobs in the background
        signal.signal(signal.SIGINT, leave)
    from stages.cli import main as command

    signal.signal(signal.SIGINT, as_before)
    try:
        return command()
    except KeyboardInterrupt:  # before the command has begun to handle it
        leave()


def leave(*_: int | FrameType | None) -> NoReturn:
    """End the process at once: an exception in the middle of imports would end it with their traceback."""
    with suppress(OSError):
        os.write(2, b"unshade: Interrupted before anything had begun.\n")
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
