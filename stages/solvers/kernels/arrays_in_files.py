"""Memory-mapped arrays: they are in files, and take no memory while they are not used."""

from __future__ import annotations

import mmap
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.process.free_memory import mapped


def in_file(arrays: Sequence[np.ndarray], folder: Path | None) -> list[np.ndarray]:
    """Move arrays to a file that ends with them: its pages are read again where they are used.

    Parameters
    ----------
    arrays : sequence of ndarray
    folder : Path or None
        On a disk; the file has no name there. None: they stay in memory.

    Returns
    -------
    list of ndarray
        The same values, read-only. `give_back_free_memory` takes their pages out of memory.
    """
    if folder is None or not any(array.size for array in arrays):
        return list(arrays)
    begins = list[int]()
    with tempfile.TemporaryFile(dir=folder) as file:
        for array in arrays:
            begins.append(file.seek(-(-file.tell() // array.itemsize) * array.itemsize))
            np.ascontiguousarray(array).tofile(file)
        file.flush()
        pages = mapped(file)
    return [_of(pages, begin, array) for array, begin in zip(arrays, begins, strict=True)]


def load_mapped(path: Path) -> np.ndarray:
    """Map an array that `numpy.save` wrote, read-only; `give_back_free_memory` takes its pages, as above."""
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    with path.open("rb") as file:
        return np.ndarray(array.shape, array.dtype, mapped(file), array.offset, array.strides)


def _of(pages: mmap.mmap, begin: int, array: np.ndarray) -> np.ndarray:
    """Find an array in its file."""
    if not array.size:
        return array
    return np.frombuffer(pages, array.dtype, array.size, begin).reshape(array.shape)
