"""Run work in a child process, so that a signal ends it at once even inside native code.

Python delivers signals between two of its own instructions. A library that computes for a minute, and may
hold the interpreter's lock meanwhile, delays them; some libraries print their stack instead. So the parent
waits and takes the signals, and the child, which computes, does not receive them.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from signal import Signals
from typing import NoReturn

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
PATIENCE_S = 1.0  # until a killed child is gone: one with much memory, or in a system call, takes its time
POLL_S = 0.005
DIES_WITH_PARENT = sys.platform.startswith("linux")  # a child does; elsewhere it goes on to its end
PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36  # of prctl(2)


@dataclass(frozen=True)
class Ending:
    """How a child ended.

    Attributes
    ----------
    code : int
        Its exit code; 128 and the signal's number where the parent received one; 1 after a crash.
    signal : Signals or None
        The signal that ended it.
    requested : bool
        The parent received the signal; else the child did, by a crash or from the system.
    """

    code: int
    signal: Signals | None = None
    requested: bool = False


def run_in_child(work: Callable[[], int]) -> Ending:
    """Fork, run `work` in the child, and wait for it. Call it from the main thread, before others start.

    The child ends by the exit code that `work` returns. It dies when the parent is killed (on Linux), and as
    soon as the parent receives SIGINT, SIGTERM or SIGHUP, unless that signal is ignored. Children of its own,
    which die with it, are waited for.
    """
    _adopt_orphans()
    heeded = [one for one in ENDING if signal.getsignal(one) is not signal.SIG_IGN]
    with _blocked({*ENDING, signal.SIGCHLD}):
        child = begin_child(work)
        ending = _wait(child, {*heeded, signal.SIGCHLD})
        if ending.signal is not None:
            _await_children()
        if ending.requested:
            for one in heeded:  # a second one, as `timeout` sends it, must not disturb the clearing up
                signal.signal(one, signal.SIG_IGN)
    return ending


@contextmanager
def _blocked(signals: set[Signals]) -> Iterator[None]:
    """Keep signals pending, for `sigwait`; threads and children inherit it."""
    former = signal.signal(signal.SIGCHLD, lambda *_: None)  # some systems drop it where nothing handles it
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGCHLD, former)


def begin_child(work: Callable[[], int]) -> int:
    """Fork this process to do `work` in the child; returns the child's number.

    The child ends by the exit code that `work` returns, and on Linux it dies with this process.
    """
    _flush_streams()  # else the child would write the same text again
    parent = os.getpid()
    child = os.fork()
    if child == 0:
        _work_as_child(work, parent)
    return child


def _work_as_child(work: Callable[[], int], parent: int) -> NoReturn:
    """Run `work` and leave without the interpreter's farewell, in which native libraries may crash."""
    code = 1
    try:
        die_with(parent)
        code = work()
    except BaseException:
        traceback.print_exc()
    finally:
        _flush_streams()
        os._exit(code)


def _flush_streams() -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()


def die_with(parent: int) -> None:
    """Ask Linux for SIGKILL when the parent, of that number, dies; elsewhere the child goes on to its end."""
    if DIES_WITH_PARENT:
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it died before
            os._exit(1)


def _wait(child: int, awaited: set[Signals]) -> Ending:
    """Wait for the child to end, or for a signal, upon which the child is killed."""
    while True:
        received = signal.sigwait(awaited)
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            code = os.waitstatus_to_exitcode(status)
            return Ending(code) if code >= 0 else Ending(1, Signals(-code))
        if received != signal.SIGCHLD:
            os.kill(child, signal.SIGKILL)
            return Ending(128 + received, Signals(received), requested=True)


def _adopt_orphans() -> None:
    """Ask Linux for the children of a child that dies, so that they can be waited for."""
    if DIES_WITH_PARENT:
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)


def _await_children() -> None:
    """Wait until all children, and orphans of theirs, are gone."""
    deadline = time.monotonic() + PATIENCE_S
    with suppress(ChildProcessError):  # there are none any more
        while time.monotonic() < deadline:
            if os.waitpid(-1, os.WNOHANG)[0] == 0:
                time.sleep(POLL_S)
