"""Products of sparse with dense matrices, rows on all threads; the plain reference is scipy's ``@``."""

from __future__ import annotations

import numba
import numpy as np
import scipy.sparse as sp

import stages.solvers.kernels.threading_layer  # noqa: F401


def product(sparse: sp.csr_array, dense: np.ndarray, rows: slice = slice(None)) -> np.ndarray:
    """Multiply rows of a sparse matrix, (·, V), with a dense one, (V, K): the same bits as ``@``.

    scipy uses one thread, and copies the rows that are selected.
    """
    begin, end, _ = rows.indices(sparse.shape[0])
    out = np.empty((max(0, end - begin), dense.shape[1]), np.result_type(sparse.dtype, dense.dtype))
    first = sparse.indptr[begin : end + 1]
    _sum_rows(first, sparse.indices, sparse.data, np.ascontiguousarray(dense), out)
    return out


@numba.njit(parallel=True, cache=True, nogil=True)
def _sum_rows(first, column, value, dense, out):
    """Sum ``Σ_j a_ij x_jk`` in the order in which j are stored, three columns at a time: a colour."""
    zero, columns = out.dtype.type(0), out.shape[1]
    for i in numba.prange(len(out)):
        stored = range(first[i], first[i + 1])
        for k in range(0, columns - 2, 3):
            red = green = blue = zero
            for place in stored:
                weight, j = value[place], column[place]
                red += weight * dense[j, k]
                green += weight * dense[j, k + 1]
                blue += weight * dense[j, k + 2]
            out[i, k], out[i, k + 1], out[i, k + 2] = red, green, blue
        for k in range(columns - columns % 3, columns):
            total = zero
            for place in stored:
                total += value[place] * dense[column[place], k]
            out[i, k] = total
