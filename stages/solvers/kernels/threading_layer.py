"""Which threads numba uses for ``prange``; imported by the modules whose loops share rows.

OpenMP first: numba would otherwise try TBB first, and warn where another library (open3d) has brought an old
one. Which it is does not change a result.
"""

from __future__ import annotations

import numba

# numba makes the names in its config when it is imported: no type checker sees them.
numba.config.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]  # type: ignore[attr-defined]


def use_threads(count: int) -> None:
    """Let compiled loops use `count` threads, as far as numba was started with so many."""
    most = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]  # as above
    numba.set_num_threads(max(1, min(count, most)))
