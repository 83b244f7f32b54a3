"""Memory that is free again, given back to the system: the C library keeps it for what may come.

Coarse levels come and go in sizes that the allocator serves from its own heap. What they leave there is too
scattered for a fine level, a tenth of all that the solver takes.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

LARGE_BYTES = 2**20  # far above what is asked for in numbers, far below an array over a large level's pixels
MMAP_THRESHOLD = -3  # M_MMAP_THRESHOLD of glibc's malloc.h


def keep_large_blocks_apart() -> None:
    """Have blocks of `LARGE_BYTES` or more go back, from now on, to the system as soon as they are free.

    glibc raises that limit with every such block that is let go, until it keeps blocks of 32 MiB. Holds for
    the whole process; does nothing with another C library.
    """
    _of_glibc("mallopt", lambda mallopt: mallopt(MMAP_THRESHOLD, LARGE_BYTES))


def give_back_free_memory() -> None:
    """Let go of all free pages; does nothing with another C library."""
    _of_glibc("malloc_trim", lambda malloc_trim: malloc_trim(0))


def _of_glibc(name: str, call: Callable[[Callable[..., int]], int]) -> None:
    try:
        function = getattr(ctypes.CDLL(None), name)
    except (AttributeError, OSError, TypeError):  # another C library; no handle of the process itself
        return
    call(function)
