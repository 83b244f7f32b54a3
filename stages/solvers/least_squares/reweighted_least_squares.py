"""Iteratively reweighted least squares for L1 energies: weights, smoothed energy, normal equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp


def l1_weights(residual: np.ndarray, delta: float) -> np.ndarray:
    """Compute the weights of squared residuals, ``1 / |residual|_δ`` with ``|·|_δ = max(δ, |·|)``, any shape.

    Eq. 12: ``w_i(p) = 1 / |I^i(p) − ρ^i(p) σ^i·ν^i(p)|_δ``

    Eq. 14: ``w_∂xρ^i(p) = 1 / |∂x ρ^i(p)|_δ``

    Eq. 15: ``w_∂yρ^i(p) = 1 / |∂y ρ^i(p)|_δ``

    Eq. 16: ``w_ij(p^i, p^j) = 1 / |ρ^i(p^i) − ρ^j(p^j)|_δ``
    """
    return 1 / np.maximum(np.abs(residual), delta)


def smoothed_absolute(residual: np.ndarray, delta: float) -> np.ndarray:
    """Evaluate the smoothed absolute value whose descent these weights guarantee.

    ``h_δ(r) = |r|`` for |r| > δ, else ``r²/(2δ) + δ/2``.

    Notes
    -----
    With ``w = l1_weights(r₀, δ)``, ``h_δ(r) ≤ h_δ(r₀) + w (r² − r₀²)/2`` for every r, with equality at r₀:
    lowering the weighted squares lowers Σ h_δ.
    """
    size = np.abs(residual)
    return np.where(size > delta, size, residual * residual / (2 * delta) + delta / 2)


def without_empty_rows(operator: sp.csr_array) -> sp.csr_array:
    """Drop the empty rows: missing differences, which no norm should count."""
    return operator[np.diff(operator.indptr) > 0]


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """``Diag(d) + Σ_e c_e (e_head − e_tail)(e_head − e_tail)ᵀ`` with a fixed pattern and changing weights.

    Each difference of two unknowns contributes to two diagonal and two off-diagonal entries. Their places are
    computed once, so that reweighting only fills in values. The pattern may be shared between threads.

    Attributes
    ----------
    tail, head : ndarray, shape (E,), int64
        The unknowns that difference e subtracts and adds.
    indptr, indices : ndarray
        CSR pattern of the N × N matrix.
    on_diagonal : ndarray, shape (N,)
        Place of every diagonal entry among the values.
    above, below : ndarray, shape (E,)
        Places of the entries (tail, head) and (head, tail).
    """

    tail: np.ndarray
    head: np.ndarray
    indptr: np.ndarray
    indices: np.ndarray
    on_diagonal: np.ndarray
    above: np.ndarray
    below: np.ndarray

    @classmethod
    def of(cls, operators: Sequence[sp.csr_array]) -> NormalEquations:
        """Compute the pattern of Σ DᵀWD for operators whose every row is one −1 and one +1.

        Raises
        ------
        ValueError
            A row is something else, or two rows have the same two unknowns.
        """
        size = operators[0].shape[1]
        ends = [_ends(operator) for operator in operators]
        tail = np.concatenate([first for first, _ in ends])
        head = np.concatenate([second for _, second in ends])
        own = np.arange(size)
        rows, columns = np.concatenate([own, tail, head]), np.concatenate([own, head, tail])
        places = sp.csr_array((np.arange(1, rows.size + 1), (rows, columns)), shape=(size, size))
        places.sort_indices()
        if places.nnz != rows.size:
            raise ValueError("Two differences link the same two unknowns; the pattern expects one.")
        place_of = np.empty(rows.size, np.int32)
        place_of[places.data - 1] = np.arange(rows.size)
        on_diagonal, above, below = np.split(place_of, [size, size + tail.size])
        return cls(tail, head, places.indptr, places.indices, on_diagonal, above, below)

    def assemble(self, diagonal: np.ndarray, weights: np.ndarray) -> sp.csr_array:
        """Assemble the normal equations of the least-squares problem

        Eq. 17: ``argmin ‖J ρ − b‖²`` with
        ``J = [Diag(√w σ·ν) ; √λ Diag(√w_x) D_x ; √λ Diag(√w_y) D_y ; √μ Diag(√w_ij) C]`` and
        ``b = [Diag(√w) I ; 0 ; 0 ; 0]``.

        Parameters
        ----------
        diagonal : ndarray, shape (N,), float64
            ``w (σ·ν)²``.
        weights : ndarray, shape (E,), float64
            ``λ w_x``, ``λ w_y``, ``μ w_ij``, in the order of the operators.

        Returns
        -------
        csr_array, shape (N, N), float64
            JᵀJ: a graph Laplacian plus a non-negative diagonal, hence an M-matrix.
        """
        size = diagonal.size
        values = np.empty(self.indices.size)
        values[self.above] = -weights
        values[self.below] = -weights
        degree = np.bincount(self.tail, weights, size) + np.bincount(self.head, weights, size)
        values[self.on_diagonal] = diagonal + degree
        return sp.csr_array((values, self.indices, self.indptr), shape=(size, size))


def _ends(operator: sp.csr_array) -> tuple[np.ndarray, np.ndarray]:
    """Find the columns of the −1 and of the +1 of every row."""
    operator = operator.tocsr()
    pairs = operator.data.reshape(-1, 2) if operator.nnz == 2 * operator.shape[0] else np.zeros((1, 2))
    ordinary = np.all(np.diff(operator.indptr) == 2) and np.all(np.sort(pairs, axis=1) == [-1, 1])
    if operator.shape[0] and not ordinary:
        raise ValueError("Every row must hold one −1 and one +1; drop the empty rows first.")
    columns = operator.indices.astype(np.int64)
    return columns[operator.data < 0], columns[operator.data > 0]
