"""Standard streams and encoding of the process, made fit for any caller: closed, full, broken, ASCII."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import Any, TextIO


def prepare_process() -> None:
    """Open the standard streams that are closed, let them take any text, and read file names as UTF-8.

    For a program, not a library: starts the interpreter again where it reads file names in another encoding.
    """
    _open_closed_streams()
    _restart_in_utf8()
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # names of files need not be text


def _open_closed_streams() -> None:
    """Open the null device on closed descriptors 0, 1, 2.

    The next file opened would take such a number, and get what libraries print.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # it was closed when Python began
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123 -- for good


def _restart_in_utf8() -> None:
    """Execute the same command in UTF-8 mode, where the locale would have names read as ASCII or Latin-1.

    Libraries take names as UTF-8, and records of one photo must not depend on the locale.
    """
    if sys.getfilesystemencoding().lower() not in ("utf-8", "utf8"):
        os.execv(sys.executable, [sys.executable, "-X", "utf8", *sys.orig_argv[1:]])


class Messages:
    """The error stream of the moment; what it cannot take is dropped, since a run outlives its terminal."""

    def write(self, text: str) -> int:
        """Write what can be written."""
        with suppress(OSError, ValueError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush what can be flushed."""
        with suppress(OSError, ValueError):
            self._stream.flush()

    @property
    def _stream(self) -> TextIO:
        return getattr(sys.stderr, "rich_proxied_file", sys.stderr)  # rich replaces it while it draws bars

    def __getattr__(self, name: str) -> Any:
        """Look up everything else (`isatty`, `encoding`, `fileno`) in the stream itself."""
        if name == "rich_proxied_file":
            raise AttributeError(name)
        return getattr(self._stream, name)
