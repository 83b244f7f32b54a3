"""Return of freed memory to the system: the C library keeps it for later allocations.

The allocator serves coarse levels from its own heap. The blocks that they leave there are too fragmented
for a fine level, and make up a tenth of the solver's memory.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

LARGE_BYTES = 2**20  # far above frequent allocations, far below an array over a large level's pixels
MMAP_THRESHOLD = -3  # M_MMAP_THRESHOLD of glibc's malloc.h


def keep_large_blocks_apart() -> None:
    """Fix the limit from which freed blocks return to the system at once, at `LARGE_BYTES`.

    glibc otherwise raises the limit with every such block that is freed, up to 32 MiB. Applies to the whole
    process; does nothing with another C library.
    """
    _of_glibc("mallopt", lambda mallopt: mallopt(MMAP_THRESHOLD, LARGE_BYTES))


def give_back_free_memory() -> None:
    """Return all free pages to the system; does nothing with another C library."""
    _of_glibc("malloc_trim", lambda malloc_trim: malloc_trim(0))


def _of_glibc(name: str, call: Callable[[Callable[..., int]], int]) -> None:
    try:
        function = getattr(ctypes.CDLL(None), name)
    except (AttributeError, OSError, TypeError):  # another C library; no handle of the process itself
        return
    call(function)
