"""Linear solvers that rivals use in the albedo step; each takes A, b and a start, and gives x.

The packages are optional: ``pip install 'unshade[benchmarks]'``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, cg

from stages.photometry.paper.settings import PaperSettings

PAPER = PaperSettings()  # tolerance and steps of conjugate gradients

Preconditioner = Callable[[sp.csr_matrix], object]
Check = Callable[..., None]


@dataclass(frozen=True)
class InnerSolver:
    """Conjugate gradients with some preconditioner.

    Attributes
    ----------
    name : str
    precondition : callable or None
        Makes scipy's argument M.
    package : str or None
        Package that must be importable.
    """

    name: str
    precondition: Preconditioner | None
    package: str | None = None

    @property
    def available(self) -> bool:
        """True if its package is installed."""
        return self.package is None or find_spec(self.package) is not None

    def solve(self, matrix: sp.csr_array, rhs: np.ndarray, start: np.ndarray, check: Check) -> np.ndarray:
        """Solve ``A x = b``; `check` is called after every step, and may raise."""
        matrix = sp.csr_matrix(matrix)
        free = matrix.diagonal() == 0
        if free.any():  # a pixel without light, neighbour or link keeps its start; factors need a number
            matrix = sp.csr_matrix(matrix + sp.diags_array(free.astype(np.float64)))
        given = self.precondition(matrix) if self.precondition else None
        check()
        x, _ = cg(
            matrix,
            rhs,
            x0=start,
            rtol=PAPER.cg_tolerance,
            maxiter=PAPER.cg_max_steps,
            M=given,
            callback=check,
        )
        return x


def _jacobi(matrix: sp.csr_matrix) -> LinearOperator:
    inverse = 1 / matrix.diagonal()
    return LinearOperator(matrix.shape, matvec=lambda v: inverse * v, dtype=matrix.dtype)


def _ruge_stuben(matrix: sp.csr_matrix) -> LinearOperator:
    import pyamg

    return pyamg.ruge_stuben_solver(matrix).aspreconditioner()


def _approx_chol(matrix: sp.csr_matrix) -> object:
    import approx_chol

    rows, columns = matrix.indptr.astype(np.uint32), matrix.indices.astype(np.uint32)
    return approx_chol.factorize_raw(rows, columns, matrix.data, matrix.shape[0])


def _apxchol(matrix: sp.csr_matrix) -> LinearOperator:
    import apxchol

    return apxchol.factorize(matrix, keep_factor=False).aspreconditioner()


INNER_SOLVERS = (
    InnerSolver("paper, plain CG", None),
    InnerSolver("paper, Jacobi CG", _jacobi),
    InnerSolver("pyamg", _ruge_stuben, "pyamg"),
    InnerSolver("approx-chol", _approx_chol, "approx_chol"),
    InnerSolver("apxchol", _apxchol, "apxchol"),
)
