"""Memory of a stage: compared with what is free before it begins; a sentence with advice where it ran out."""

from __future__ import annotations

import logging
import resource
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pipeline.errors import MachineError, UserError
from pipeline.job import Job
from pipeline.process.meter import kilobytes, resident_bytes
from pipeline.settings import Settings
from pipeline.stage import AnyStage

WORTH_SAYING = 1_000_000_000  # bytes: less is at hand anywhere
FAR_BEYOND = 4  # times the free memory, from which a stage is not begun: swap and caches may give way
FAR_BEYOND_ALLOWED = 1.5  # times the allowed memory: estimates are right within a half
NATIVE = (  # how libraries in other languages say it, in exceptions of other types
    "bad_alloc",
    "insufficient memory",
    "out of memory",
    "cannot allocate memory",
    "can't start new thread",
    "resource temporarily unavailable",  # as a RuntimeError: of a thread
    "failed to map segment",  # of a library's code
)
_PROC, _CGROUPS = Path("/proc"), Path("/sys/fs/cgroup")
_AT_FIRST = resident_bytes()  # of this process, before any stage has loaded a library


def compare_with_allowed_memory(stage: AnyStage, job: Job[Settings], allowed: int | None) -> int | None:
    """Note the estimate of a stage's memory, and warn where it exceeds what is allowed or free; return it.

    Estimates are of a process that begins: what this one holds already, of libraries above all, counts too.
    `allowed`: bytes; None: what is free.

    Raises
    ------
    MachineError
        It exceeds that by far.
    """
    needed, free = stage.memory(job.settings, job.inputs, job.threads), free_bytes()
    held = max(resident_bytes() - _AT_FIRST, 0)
    told = "estimated memory %s beside %s, allowed %s, free %s"
    logging.getLogger(stage.name).info(told, needed, held, allowed, free)
    if needed is None:
        return None
    job.note(estimated_bytes=needed)
    in_all = needed + held
    within = (allowed is None or in_all <= allowed) and (free is None or needed <= free)
    if within and in_all >= WORTH_SAYING:
        job.say(f"Will take about {gigabytes(in_all)} of memory.")
    if allowed is not None and in_all > allowed:
        _tell(stage, job, in_all, f"--memory allows {gigabytes(allowed)}", FAR_BEYOND_ALLOWED * allowed)
    if free is not None and needed > free:
        _tell(stage, job, needed, f"{gigabytes(free)} are free", FAR_BEYOND * free)
    return needed


def _tell(stage: AnyStage, job: Job[Settings], needed: int, bound: str, far_beyond: float) -> None:
    """Warn that a stage needs more than a bound; refuse where it needs far more."""
    said = f"{stage.name} needs about {gigabytes(needed)} of memory, and {bound}"
    if needed > far_beyond:
        raise MachineError(f"{said}: it was not begun. {advice(stage)}Earlier results are kept.")
    job.say(f"{said}: it may not come to its end. {advice(stage)}".rstrip())


@contextmanager
def memory_errors_told(stage: AnyStage) -> Iterator[None]:
    """Turn a lack of memory within a block into a sentence.

    Raises
    ------
    MachineError
        The stage ran out of memory.
    """
    try:
        yield
        return
    except Exception as error:
        if not is_out_of_memory(error):
            raise
    # Outside the handler: the error holds the frames of the stage, and with them all its arrays.
    raise MachineError(
        f"{stage.name} ran out of memory; expected room for more, or less to do. "
        f"{advice(stage)}Earlier results are kept."
    )


def is_out_of_memory(error: BaseException) -> bool:
    """Check whether an error, or one that it came from, says that memory for data, code or threads lacks."""
    if isinstance(error, UserError | MachineError | BlockingIOError):
        return False  # they know what they say, whatever they came from
    said = str(error).lower()
    if isinstance(error, MemoryError) or any(words in said for words in NATIVE):
        return True
    origin = error.__cause__ or error.__context__
    return origin is not None and is_out_of_memory(origin)


def free_bytes() -> int | None:
    """Measure the memory that this process can still take; None where the system does not say.

    The least of what the machine has, and what limits of the process and its control group leave.
    """
    known = [value for value in (_of_machine(), _of_limit(), _of_control_group()) if value is not None]
    return min(known, default=None)


def machine_bytes() -> int | None:
    """Look up the memory that this machine, or the container, has in all; None where it does not say."""
    known = [1024 * total] if (total := kilobytes(_PROC / "meminfo", "MemTotal")) is not None else []
    with suppress(OSError, ValueError):
        known.append(int((_CGROUPS / "memory.max").read_text()))  # "max" without one
    return min(known, default=None)


def _of_machine() -> int | None:
    """Sum available memory and swap space of the machine."""
    found = kilobytes(_PROC / "meminfo", "MemAvailable", "SwapFree")
    return None if found is None else 1024 * found


def _of_limit() -> int | None:
    """Subtract the address space in use from the limit on it (`ulimit -v`), if there is one."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    used = kilobytes(_PROC / "self/status", "VmSize")
    return None if limit == resource.RLIM_INFINITY or used is None else max(0, limit - 1024 * used)


def _of_control_group() -> int | None:
    """Subtract the memory in use from the limit of a container (cgroup v2), if there is one."""
    try:
        limit = int((_CGROUPS / "memory.max").read_text())  # "max" without one
        used = int((_CGROUPS / "memory.current").read_text())
        lines = (_CGROUPS / "memory.stat").read_text().splitlines()
        reclaimable = sum(int(line.split()[1]) for line in lines if line.startswith("inactive_file "))
    except (OSError, ValueError):
        return None
    return max(0, limit - used + reclaimable)


def advice(stage: AnyStage) -> str:
    """Say which settings lower the memory of a stage: a sentence with a space after it, or nothing."""
    return f"For less memory, {stage.saves_memory}. " if stage.saves_memory else ""


def gigabytes(size: int) -> str:
    """Write bytes as a user reads them."""
    return f"{size / 1e9:.1f} GB"
