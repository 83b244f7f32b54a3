"""Memory that is free again, given back to the system: the C library keeps it for smaller things."""

from __future__ import annotations

import ctypes


def give_back_free_memory() -> None:
    """Let go of all free pages; does nothing where the C library has no such call.

    Coarse levels come and go in sizes that the allocator serves from its own heap. What they leave there is
    too scattered for a fine level, a tenth of all that the solver takes.
    """
    try:
        trim = ctypes.CDLL(None).malloc_trim  # glibc
    except (AttributeError, OSError, TypeError):  # another C library; no handle of the process itself
        return
    trim(0)
