"""Numba's threading layer for ``prange``; imported by the modules with parallel loops.

OpenMP comes first: numba would otherwise try TBB first, and warn where another library (open3d) has loaded an
old one. The choice does not change a result.
"""

from __future__ import annotations

from importlib import import_module

import numba

# numba creates the names in its config at import: no type checker sees them.
numba.config.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]  # type: ignore[attr-defined]


def loops_may_run_at_once() -> bool:
    """Check whether several threads may be in parallel loops at once: not with numba's own layer."""
    if numba.config.THREADING_LAYER == "workqueue":  # type: ignore[attr-defined]  # as above
        return False
    try:
        import_module("numba.np.ufunc.omppool")  # which needs the compiler's OpenMP runtime
    except ImportError:
        return False
    return True


def use_threads(count: int) -> None:
    """Set the number of threads of compiled loops, limited to those numba was started with."""
    most = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]  # as above
    numba.set_num_threads(max(1, min(count, most)))
