"""Processors that this process may use."""

from __future__ import annotations

import os
from math import ceil
from pathlib import Path

_QUOTA = Path("/sys/fs/cgroup/cpu.max")


def usable_processors() -> int:
    """Count the processors that this process may run on, at most as many as its container has time of."""
    bound = affine_processors()
    quota = processor_quota()
    return bound if quota is None else max(1, min(bound, ceil(quota)))


def affine_processors() -> int:
    """Count the processors that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def processor_quota() -> float | None:
    """Look up how many processors' time the container may take (cgroup v2); None without such a limit."""
    try:
        quota, period = _QUOTA.read_text().split()
        return int(quota) / int(period)  # "max" without a limit
    except (OSError, ValueError, ZeroDivisionError):
        return None
