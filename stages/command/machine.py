"""What a command may take of the machine: threads, memory, workers."""

from __future__ import annotations

import re

from pipeline import UserError
from pipeline.cluster.on_demand import ClusterRequest
from pipeline.errors import shortened
from pipeline.process.memory_limits import machine_bytes
from pipeline.process.processors import usable_processors
from stages.command.arguments import Doctor, Given

MOST_THREADS = 1024
PREFIXES = ("", "K", "M", "G", "T")
SHARE_OF_MACHINE = 0.7  # of all its memory rather than of what is free: keys stay those of the last run
LEAST_MEMORY, MOST_MEMORY = 500_000_000, 10**15  # the libraries alone take half of the least


def threads_of(command: Given | Doctor) -> int:
    """Choose the number of threads: the one given, else all processors available to this process.

    Raises
    ------
    UserError
        The given number is below one, or more than libraries can start.
    """
    if command.threads is None:
        return usable_processors()
    if not 1 <= command.threads <= MOST_THREADS:
        raise UserError(
            f"--threads is {command.threads}; expected 1 to {MOST_THREADS}, or none for all processors."
        )
    return command.threads


def cluster_of(command: Given) -> ClusterRequest | None:
    """Read where the tasks of stages run; None: on threads of this process.

    Raises
    ------
    UserError
        Workers and a scheduler were given, or the number of workers is below one or enormous.
    """
    workers, scheduler = command.workers, command.scheduler
    if workers is None and scheduler is None:
        return None
    if workers is not None and scheduler is not None:
        raise UserError(
            f"--workers {workers} and --scheduler {scheduler} were given; expected workers of this machine "
            "or those of a scheduler. Leave out one."
        )
    if workers is not None and not 1 <= workers <= MOST_THREADS:
        raise UserError(f"--workers is {workers}; expected 1 to {MOST_THREADS}, or none.")
    return ClusterRequest(workers, scheduler)


def memory_to_fit(given: int | None) -> int | None:
    """Choose the memory, bytes, into which stages divide their work: the one given, or most of the machine's.

    None where neither is known. The machine's is rounded to two digits: what a system keeps for itself
    changes with its version, and settings that follow from it are part of keys.
    """
    machine = machine_bytes()
    if given is not None or machine is None:
        return given
    share = int(SHARE_OF_MACHINE * machine)
    step = 10 ** max(len(str(share)) - 2, 0)
    return max(share // step * step, LEAST_MEMORY)


def memory_of(command: Given | Doctor) -> int | None:
    """Read the memory that a stage may take, bytes; None where none was given.

    Raises
    ------
    UserError
        It is no size, or less than the libraries need.
    """
    if command.memory is None:
        return None
    match = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)\s*([KMGT]?)(i?)B?", command.memory.strip(), re.IGNORECASE)
    size = 0.0
    if match:
        number, prefix, binary = match.groups()
        size = float(number) * (1024 if binary else 1000) ** PREFIXES.index(prefix.upper())
    if not LEAST_MEMORY <= size <= MOST_MEMORY:
        raise UserError(
            f"--memory is {shortened(command.memory)}; expected a size of at least "
            f"{LEAST_MEMORY // 10**6} MB, as in --memory 6GB."
        )
    return int(size)
