"""What libraries write while a stage runs: Python's warnings, and the streams of native code."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

OUTPUT, ERRORS = 1, 2  # the descriptors that native code writes to


@contextmanager
def library_messages_in(path: Path) -> Iterator[None]:
    """Append what libraries write to a file; what this program says still reaches the terminal.

    Where `sys.stderr` is not the process's error stream, as in a test that captures it, only native code's
    messages are redirected. This program writes nothing to the output stream meanwhile.
    """
    kept = _duplicates()
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    errors, own = sys.stderr, None
    for own_stream in (sys.stdout, errors):
        with suppress(AttributeError, OSError, ValueError):  # none, full or closed
            own_stream.flush()
    try:
        if ERRORS in kept and _writes_to(errors, ERRORS):
            own = os.fdopen(
                os.dup(kept[ERRORS]), "w", encoding=errors.encoding, errors=errors.errors, buffering=1
            )
            sys.stderr = own
        for stream in kept:
            os.dup2(file, stream)
        logging.captureWarnings(True)
        yield
    finally:
        logging.captureWarnings(False)
        for stream, place in kept.items():
            os.dup2(place, stream)
            os.close(place)
        os.close(file)
        sys.stderr = errors
        if own is not None:
            with suppress(OSError):  # a stream that is full or broken is no fault of the stage
                own.close()


def _duplicates() -> dict[int, int]:
    """Duplicate the descriptors of the streams that are open."""
    found = {}
    for stream in (OUTPUT, ERRORS):
        with suppress(OSError):
            found[stream] = os.dup(stream)
    return found


def _writes_to(stream: object, descriptor: int) -> bool:
    try:
        return stream.fileno() == descriptor  # type: ignore[attr-defined]  # some have none
    except (AttributeError, OSError, ValueError):
        return False
