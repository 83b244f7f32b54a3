"""Elapsed time, processor time and peak memory of a stage."""

from __future__ import annotations

import gc
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pipeline.process.free_memory import give_back_free_memory

_beside_bytes = 0  # peaks of other processes and what this one had then, since the block began
_STATUS = Path("/proc/self/status")
_CLEAR = Path("/proc/self/clear_refs")


@dataclass
class Reading:
    """Elapsed seconds, processor seconds and peak bytes, set when the measured block ends."""

    seconds: float = 0.0
    cpu_seconds: float = 0.0
    peak_bytes: int = 0


@contextmanager
def measured() -> Iterator[Reading]:
    """Measure a block. Where the system cannot reset its peak, the peak is that of the process so far.

    What the C library keeps of memory that an earlier block let go would count as this one's: it is returned.
    """
    reading = Reading()
    gc.collect()
    give_back_free_memory()
    _reset_peak()
    global _beside_bytes
    _beside_bytes = 0
    clock, cpu = time.perf_counter(), _cpu_seconds()
    try:
        yield reading
    finally:
        reading.seconds = round(time.perf_counter() - clock, 3)
        reading.cpu_seconds = round(_cpu_seconds() - cpu, 3)
        reading.peak_bytes = max(peak_bytes(), _beside_bytes)


def count_processes(their_peaks_bytes: int) -> None:
    """Count the summed peaks of processes that ran at the same time beside what this one has now."""
    global _beside_bytes
    _beside_bytes = max(_beside_bytes, their_peaks_bytes + resident_bytes())


def resident_bytes() -> int:
    """Look up the memory that this process holds now, bytes; 0 where the system does not say."""
    return 1024 * (kilobytes(_STATUS, "VmRSS") or 0)


def _cpu_seconds() -> float:
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def _reset_peak() -> None:
    """Reset the peak (VmHWM) on Linux by writing 5 to clear_refs."""
    try:
        _CLEAR.write_text("5")
    except OSError:
        return


def peak_bytes() -> int:
    """Look up the peak of this process since it was last reset, or began, bytes.

    Where the system has no ``VmHWM``, the peak of `getrusage`, which a new process inherits from the one that
    began it.
    """
    peak = kilobytes(_STATUS, "VmHWM")
    if peak is not None:
        return 1024 * peak
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def kilobytes(file: Path, *names: str) -> int | None:
    """Sum values of a file of `name: value kB` lines; None where one is missing."""
    try:
        lines = [line.partition(":") for line in file.read_text().splitlines()]
    except OSError:
        return None
    found = {name: int(value.split()[0]) for name, _, value in lines if name in names}
    return sum(found.values()) if len(found) == len(names) else None
