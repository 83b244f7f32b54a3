"""Arithmetic over pixels on several threads: NumPy releases the interpreter's lock, but computes on one.

The number of threads is that of compiled loops (`use_threads`). It never changes a result: the parts are the
same, and so is the order within each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401

CHUNK = 2**15  # pixels: temporary arrays of a chunk stay in the cache
Chosen = slice | np.ndarray  # some of all pixels
EVERYWHERE = slice(None)
Item = TypeVar("Item")
Made = TypeVar("Made")


def on_threads(work: Callable[[Item], Made], items: Iterable[Item]) -> list[Made]:
    """Map a function over items; results in their order."""
    with ThreadPoolExecutor(numba.get_num_threads()) as executor:
        return list(executor.map(work, items))


def pixelwise(work: Callable[..., Any], *arrays: np.ndarray) -> Any:
    """Apply a function of arrays, (N, …) each, that treats every pixel alike, to chunks of pixels.

    Returns
    -------
    ndarray, shape (N, …), or tuple of them
        As `work` returns for all pixels at once.
    """
    count = len(arrays[0])
    if count <= CHUNK:
        return work(*arrays)
    first = work(*(array[:CHUNK] for array in arrays))
    several = isinstance(first, tuple)
    made = tuple(np.empty((count, *one.shape[1:]), one.dtype) for one in (first if several else (first,)))

    def store(begin: int, values: Any) -> None:
        for out, own in zip(made, values if several else (values,), strict=True):
            out[begin : begin + CHUNK] = own

    def compute(begin: int) -> None:
        store(begin, work(*(array[begin : begin + CHUNK] for array in arrays)))

    store(0, first)
    on_threads(compute, range(CHUNK, count, CHUNK))
    return made if several else made[0]
