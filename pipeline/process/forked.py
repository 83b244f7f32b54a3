"""Run work in a fork that tells of its progress, for libraries that keep memory until the process ends.

So do loops that were compiled, and what the C library cannot give back: half a gigabyte after some stages.
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, NoReturn, TypeVar

from pipeline.errors import MachineError
from pipeline.process.child import begin_child

Made = TypeVar("Made")
Tell = Callable[..., None]

TOLD, MADE, RAISED = range(3)  # kinds of messages


class InFork(Exception):  # noqa: N818 -- the place of an error
    """Traceback of an error in a fork: the cause of the same error where the result was awaited."""

    def __str__(self) -> str:
        """Begin a line of its own."""
        return f"in a fork\n{self.args[0]}"


def in_fork(work: Callable[[Tell], Made], heard: Callable[..., None]) -> Made:
    """Do ``work(tell)`` in a fork of this process; returns its result, or raises its error.

    ``tell(*values)`` there calls ``heard(*values)`` here, in order. Values, result and error are pickled. The
    fork has no threads but its own: work must not need those of a library that was used here. It dies with
    this process; and where it is killed, or crashes, this process ends by the same signal.

    Parameters
    ----------
    work : callable
        Takes ``tell``, which several threads may call.
    heard : callable
        Called in this process with the values of each ``tell``.

    Raises
    ------
    MachineError
        The fork ended before its time, by an exit code.
    """
    receiving, sending = Pipe(duplex=False)

    def answer() -> int:
        receiving.close()
        return _answer(work, sending)

    fork = begin_child(answer)
    sending.close()
    try:
        kind, value = _listen(receiving, heard)
    except EOFError:
        _end_as(fork)
    except BaseException:
        os.kill(fork, signal.SIGKILL)
        os.waitpid(fork, 0)
        raise
    finally:
        receiving.close()
    os.waitpid(fork, 0)
    if kind == MADE:
        return value
    error, where = value
    raise error from InFork(where)


def _answer(work: Callable[[Tell], Any], sending: Connection) -> int:
    """Do the work, and send what it tells, then its result or error; returns the exit code."""
    one_at_a_time = threading.Lock()

    def send(kind: int, value: object) -> None:
        message = pickle.dumps((kind, value))
        with one_at_a_time:
            sending.send_bytes(message)

    try:
        send(MADE, work(lambda *values: send(TOLD, values)))
    except Exception as error:
        send(RAISED, (_picklable(error), traceback.format_exc()))
    return 0


def _picklable(error: Exception) -> Exception:
    """Return the error, or one that says the same, where libraries' own cannot be made again."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _listen(receiving: Connection, heard: Callable[..., None]) -> tuple[int, Any]:
    """Hear what the fork tells, until it sends a result or an error."""
    while True:
        kind, value = receiving.recv()
        if kind != TOLD:
            return kind, value
        heard(*value)


def _end_as(fork: int) -> NoReturn:
    """End this process by the signal that ended the fork; raise an error where none did."""
    _, status = os.waitpid(fork, 0)
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        os.kill(os.getpid(), -code)
    raise MachineError(
        f"A process of this run ended before its time (exit code {code}); expected its result. Run again: "
        "what was finished is kept."
    )
