"""A program in a terminal of so many columns, and what is on its screen in the end."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import signal
import struct
import subprocess
import termios
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROWS = 100
TOKEN = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|[\r\n]|[^\x1b\r\n]+")
CTRL_C = b"\x03"
PATIENCE_S = 60


@dataclass
class Screen:
    """Lines of a screen that is higher than all that is printed, and every line that was ever drawn."""

    columns: int
    lines: list[str] = field(default_factory=lambda: [""])
    drawn: list[str] = field(default_factory=list)
    row: int = 0
    column: int = 0

    def write(self, text: str) -> None:
        """Show what a program wrote."""
        for token in TOKEN.findall(text):
            if token == "\n":
                self.row += 1
                self.lines += [""] * (self.row + 1 - len(self.lines))
            elif token == "\r":
                self.column = 0
            elif token.startswith("\x1b["):
                self._control(token)
            else:
                self._put(token)

    def _control(self, token: str) -> None:
        if token.endswith("K"):
            self.lines[self.row] = ""
        elif token.endswith("A"):
            self.row -= int(token[2:-1] or 1)
        else:
            assert token[-1] in "mhl", f"{token!r} is not known here"  # colours, the cursor's look

    def _put(self, text: str) -> None:
        line = self.lines[self.row].ljust(self.column)
        self.lines[self.row] = line[: self.column] + text + line[self.column + len(text) :]
        self.column += len(text)
        self.drawn.append(self.lines[self.row])

    def widest(self) -> int:
        """Columns of the longest line that was ever drawn."""
        return max(len(line.rstrip()) for line in self.drawn)

    @property
    def text(self) -> str:
        """What is there, without spaces at the ends of lines."""
        return "\n".join(line.rstrip() for line in self.lines).strip("\n")


@dataclass
class Ended:
    """A program that has ended: its exit code, all that it wrote, and the screen."""

    code: int
    raw: str
    screen: Screen


def run_in_terminal(
    command: Sequence[str],
    columns: int,
    cwd: Path,
    environment: Mapping[str, str],
    interrupt_at: str = "",
) -> Ended:
    """Run a program in a terminal of its own; press Ctrl-C when it has written `interrupt_at`."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, columns, 0, 0))
    process = subprocess.Popen(
        command,
        cwd=cwd,
        env={"TERM": "xterm-256color", **environment},
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        preexec_fn=_take_terminal,  # noqa: PLW1509 -- no threads are at work here
    )
    os.close(theirs)
    raw = _read(ours, interrupt_at.encode())
    os.close(ours)
    screen = Screen(columns)
    screen.write(raw)
    return Ended(process.wait(PATIENCE_S), raw, screen)


def _take_terminal() -> None:
    """Begin a session that the terminal controls, so that Ctrl-C reaches it and is not ignored."""
    os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # what shells start in the background ignores it
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def _read(terminal: int, interrupt_at: bytes) -> str:
    written, deadline = b"", time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        try:
            part = os.read(terminal, 1 << 16)
        except OSError:  # the last process that had it has ended
            break
        if not part:
            break
        written += part
        if interrupt_at and interrupt_at in written:
            os.write(terminal, CTRL_C)
            interrupt_at = b""
    return written.decode()
