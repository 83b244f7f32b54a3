"""The light step: with the albedo held, every view's nine coefficients by weighted least squares."""

from __future__ import annotations

import numpy as np

from stages.photometry.paper.energy import photometric_residual
from stages.photometry.stack import StackedViews
from stages.solvers.least_squares.reweighted_least_squares import l1_weights


def light_step(
    views: StackedViews, image: np.ndarray, albedo: np.ndarray, light: np.ndarray, delta: float
) -> np.ndarray:
    """One reweighting of all lights with the albedo held.

    Eq. 11: ``σ^i = argmin Σ_p w_i(p) |I^i(p) − ρ^i(p) σ^i·ν^i(p)|²``, for every view i, with w of Eq. 12.

    Parameters
    ----------
    views : StackedViews
    image, albedo : ndarray, shape (N,), float64
    light : ndarray, shape (n, 9), float64
        σ^(k), where the weights are taken.
    delta : float

    Returns
    -------
    ndarray, shape (n, 9), float64
        σ^(k+1).
    """
    weights = l1_weights(photometric_residual(image, albedo, views.shading(light)), delta)
    return np.stack(
        [
            _weighted_fit(views.basis[own] * albedo[own, None], image[own], weights[own])
            for own in map(views.view, range(views.view_count))
        ]
    )


def _weighted_fit(columns: np.ndarray, target: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Solve ``argmin Σ w (target − columns x)²`` by pseudo-inverse: the shortest x where several fit equally.

    einsum rather than BLAS products: the same bits whatever the number of threads. Directions below a
    millionth of the strongest are the rounding of normals and basis, kept in 32 bits.
    """
    weighted = columns * weights[:, None]
    gram = np.einsum("pk,pl->kl", weighted, columns)
    return np.linalg.pinv(gram, rcond=1e-12, hermitian=True) @ np.einsum("pk,p->k", weighted, target)
