"""The light step: with the albedo held, every view's nine coefficients by weighted least squares."""

from __future__ import annotations

import numpy as np

from stages.photometry.paper.energy import photometric_residual
from stages.photometry.paper.settings import PaperSettings
from stages.photometry.stack import StackedViews
from stages.solvers.least_squares.reweighted_least_squares import l1_weights


def light_step(
    views: StackedViews, image: np.ndarray, albedo: np.ndarray, light: np.ndarray, how: PaperSettings
) -> np.ndarray:
    """Update all lights by one reweighting, with the albedo held.

    Eq. 11: ``σ^i = argmin Σ_p w_i(p) |I^i(p) − ρ^i(p) σ^i·ν^i(p)|²``, for every view i, with w of Eq. 12.

    Parameters
    ----------
    views : StackedViews
    image, albedo : ndarray, shape (N,), float64
    light : ndarray, shape (n, 9), float64
        σ^(k), at which the weights are evaluated.
    how : PaperSettings
        δ, and the rank tolerance.

    Returns
    -------
    ndarray, shape (n, 9), float64
        σ^(k+1).
    """
    weights = l1_weights(photometric_residual(image, albedo, views.shading(light)), how.delta)
    return np.stack(
        [
            _weighted_fit(views.basis[own] * albedo[own, None], image[own], weights[own], how.rank_tolerance)
            for own in map(views.view, range(views.view_count))
        ]
    )


def _weighted_fit(
    columns: np.ndarray, target: np.ndarray, weights: np.ndarray, rank_tolerance: float
) -> np.ndarray:
    """Solve ``argmin Σ w (target − columns x)²`` by pseudo-inverse: the minimum-norm solution.

    einsum rather than BLAS products: the same bits whatever the number of threads.
    """
    weighted = columns * weights[:, None]
    gram = np.einsum("pk,pl->kl", weighted, columns)
    return np.linalg.pinv(gram, rcond=rank_tolerance, hermitian=True) @ np.einsum("pk,p->k", weighted, target)
