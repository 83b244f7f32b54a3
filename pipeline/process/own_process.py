"""Run a function in a process of its own, for libraries that keep memory until the process ends."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import Any, TypeVar

from pipeline.errors import UserError

Made = TypeVar("Made")


def in_own_process(work: Callable[..., Made], *arguments: Any) -> Made:
    """Run ``work(*arguments)`` in a new process that ends after it; returns its result, or raises its error.

    Function, arguments and result are pickled. The process is spawned, not forked: threads of this one may
    hold locks.

    Raises
    ------
    UserError
        The system ended the process.
    """
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        try:
            return executor.submit(work, *arguments).result()
        except BrokenProcessPool as error:
            raise UserError(
                f"A process that ran {work.__name__.strip('_')} ended before its time, most likely because "
                "the system had no more memory. Close other programs, or give less to do at once."
            ) from error
