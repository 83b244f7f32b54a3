"""Conjugate gradients with Jacobi preconditioner, of `solver: paper`; steps are counted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, cg


@dataclass(frozen=True, eq=False)
class LinearSolution:
    """Solution of conjugate gradients.

    Attributes
    ----------
    x : ndarray, shape (N,), float64
    steps : int
        Number of steps.
    relative_residual : float
        ``|b − A x| / |b|``, computed afresh; 0 where b = 0.
    reached : bool
        Whether the tolerance was met within the steps that were allowed.
    """

    x: np.ndarray
    steps: int
    relative_residual: float
    reached: bool


def conjugate_gradient(
    matrix: sp.csr_array, rhs: np.ndarray, start: np.ndarray, tolerance: float, max_steps: int
) -> LinearSolution:
    """Solve ``A x = b`` for a symmetric positive semi-definite A, from `start`.

    Every step lowers ``½ xᵀA x − bᵀx``, so that x is better than `start` after an early stop, too: the
    descent of reweighted least squares does not depend on the tolerance.

    Parameters
    ----------
    matrix : csr_array, shape (N, N), float64
    rhs, start : ndarray, shape (N,), float64
    tolerance : float
        Relative residual |b − A x| / |b| at which to stop.
    max_steps : int

    Notes
    -----
    Deviation 2: the paper names no tolerance. If the inner solver stops early, the energy changes so little
    that the outer stopping rule mistakes it for convergence; hence the tight default in the settings.
    """
    size = float(np.linalg.norm(rhs))
    if size == 0:
        return LinearSolution(np.zeros_like(rhs), 0, 0.0, True)
    inverse = _inverse_diagonal(matrix)
    jacobi = LinearOperator(matrix.shape, matvec=lambda v: inverse * v, dtype=matrix.dtype)
    steps = 0

    def count(_: np.ndarray) -> None:
        nonlocal steps
        steps += 1

    x, left = cg(matrix, rhs, x0=start, rtol=tolerance, maxiter=max_steps, M=jacobi, callback=count)
    relative = float(np.linalg.norm(rhs - matrix @ x)) / size
    # scipy tests the recurrence's residual before each step, never after the last one.
    return LinearSolution(x, steps, relative, left == 0 or relative <= tolerance)


def _inverse_diagonal(matrix: sp.csr_array) -> np.ndarray:
    """Invert the diagonal; 1 for an empty row (no light, neighbour or correspondence)."""
    diagonal = matrix.diagonal()
    return 1 / np.where(diagonal > 0, diagonal, 1.0)
