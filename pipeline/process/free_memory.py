"""Return of memory to the system: what was freed, which the C library keeps, and pages of mapped files.

The allocator serves coarse levels from its own heap. The blocks that they leave there are too fragmented
for a fine level, and make up a tenth of the solver's memory.
"""

from __future__ import annotations

import ctypes
import gc
import mmap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import BinaryIO
from weakref import WeakSet

LARGE_BYTES = 2**20  # far above frequent allocations, far below an array over a large level's pixels
USUAL_BYTES = 2**25  # the most that glibc raises the limit to by itself
MMAP_THRESHOLD = -3  # M_MMAP_THRESHOLD of glibc's malloc.h

_mapped: WeakSet[mmap.mmap] = WeakSet()


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


def mapped(file: BinaryIO) -> mmap.mmap:
    """Map a file that is not empty, read-only: pages are read as they are used, and given back as free ones.

    See `give_back_free_memory`. The file may be closed, and need not have a name.
    """
    pages = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    _mapped.add(pages)
    return pages


def give_back_free_memory() -> None:
    """Return all free pages to the system, where its C library can, and those of `mapped` files."""
    if hasattr(mmap, "MADV_DONTNEED"):
        for pages in list(_mapped):
            pages.madvise(mmap.MADV_DONTNEED)
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
