"""Return of freed memory to the system: the C library keeps it for later allocations.

The allocator serves coarse levels from its own heap. The blocks that they leave there are too fragmented
for a fine level, and make up a tenth of the solver's memory.
"""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LARGE_BYTES = 2**20  # far above frequent allocations, far below an array over a large level's pixels
USUAL_BYTES = 2**25  # the most that glibc raises the limit to by itself
MMAP_THRESHOLD = -3  # M_MMAP_THRESHOLD of glibc's malloc.h


@contextmanager
def large_blocks_apart() -> Iterator[None]:
    """Return freed blocks from `LARGE_BYTES` on to the system at once, within a block of code.

    glibc otherwise raises the limit with every such block that is freed, up to `USUAL_BYTES`, which is the
    limit afterwards: where arrays come and go, as those of single views, the system takes longer to clear
    their pages than the arithmetic does. Applies to the whole process; does nothing with another C library.
    """
    _of_glibc("mallopt", lambda mallopt: mallopt(MMAP_THRESHOLD, LARGE_BYTES))
    try:
        yield
    finally:
        _of_glibc("mallopt", lambda mallopt: mallopt(MMAP_THRESHOLD, USUAL_BYTES))


def give_back_free_memory() -> None:
    """Return all free pages to the system; does nothing with another C library."""
    _of_glibc("malloc_trim", lambda malloc_trim: malloc_trim(0))


def give_back_garbage() -> None:
    """Free what only references to itself keep, and return all free pages to the system.

    While loops are compiled, exceptions that the compiler catches keep the frames that called it: arrays of
    a solver that has ended would stay until Python happens to look for such cycles.
    """
    gc.collect()
    give_back_free_memory()


def _of_glibc(name: str, call: Callable[[Callable[..., int]], int]) -> None:
    try:
        function = getattr(ctypes.CDLL(None), name)
    except (AttributeError, OSError, TypeError):  # another C library; no handle of the process itself
        return
    call(function)
