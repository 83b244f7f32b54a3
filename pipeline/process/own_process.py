"""Run a function in a process of its own, for libraries that keep memory until the process ends."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import Any, TypeVar

from pipeline.errors import MachineError
from pipeline.process.child import die_with
from pipeline.process.meter import count_process, peak_bytes

Made = TypeVar("Made")


def in_own_process(what: str, work: Callable[..., Made], *arguments: Any) -> Made:
    """Run ``work(*arguments)`` in a new process that ends after it; returns its result, or raises its error.

    Function, arguments and result are pickled. The process is spawned, not forked: threads of this one may
    hold locks. It dies with this one, and its peak memory counts beside what this one has.

    Parameters
    ----------
    what : str
        What it does, as in "that decimates a mesh", for the error.
    work : callable
    *arguments

    Raises
    ------
    MachineError
        The process ended before its time.
    """
    spawned = get_context("spawn")
    with ProcessPoolExecutor(1, spawned, initializer=die_with, initargs=(os.getpid(),)) as executor:
        try:
            made, its_peak = executor.submit(_measured, work, *arguments).result()
        except BrokenProcessPool as error:
            raise MachineError(
                f"The process {what} ended before its time. Where memory is full, the system ends what takes "
                "most of it: close other programs, or give less to do at once."
            ) from error
    count_process(its_peak)
    return made


def _measured(work: Callable[..., Made], *arguments: Any) -> tuple[Made, int]:
    """Do the work; returns the peak of this process as well, bytes."""
    return work(*arguments), peak_bytes()
