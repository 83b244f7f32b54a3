"""Run functions in processes of their own, for libraries that keep memory until the process ends."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import Any, TypeVar

from pipeline.errors import MachineError
from pipeline.process.child import die_with
from pipeline.process.meter import count_processes, peak_bytes

Made = TypeVar("Made")


def in_own_process(what: str, work: Callable[..., Made], *arguments: Any) -> Made:
    """Run ``work(*arguments)`` in a process of its own; as `in_own_processes` for one."""
    (made,) = in_own_processes(what, work, [arguments])
    return made


def in_own_processes(what: str, work: Callable[..., Made], arguments: Sequence[Sequence[Any]]) -> list[Made]:
    """Run ``work(*a)`` for each ``a`` of `arguments`, at the same time, in as many new processes.

    Function, arguments and results are pickled. The processes are spawned, not forked: threads of this one
    may hold locks. They die with this one, and the sum of their peaks counts beside what this one has.

    Parameters
    ----------
    what : str
        What each does, as in "that decimates a mesh", for the error.
    work : callable
    arguments : sequence of sequence

    Returns
    -------
    list
        Their results, in order. An error of one is raised when all have ended.

    Raises
    ------
    MachineError
        A process ended before its time.
    """
    spawned, this = get_context("spawn"), os.getpid()
    with ProcessPoolExecutor(len(arguments), spawned, initializer=die_with, initargs=(this,)) as executor:
        begun = [executor.submit(_measured, work, *each) for each in arguments]
        try:
            done = [each.result() for each in begun]
        except BrokenProcessPool as error:
            raise MachineError(
                f"The process {what} ended before its time. Where memory is full, the system ends what takes "
                "most of it: close other programs, or give less to do at once."
            ) from error
    count_processes(sum({process: its_peak for _, process, its_peak in done}.values()))
    return [made for made, _, _ in done]


def _measured(work: Callable[..., Made], *arguments: Any) -> tuple[Made, int, int]:
    """Do the work; returns which process did it, and its peak, bytes, as well."""
    return work(*arguments), os.getpid(), peak_bytes()
