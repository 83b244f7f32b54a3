"""The albedo step: with the light held, the albedo of all views at once by weighted least squares."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from stages.photometry.paper.energy import EnergyWeights, photometric_residual
from stages.photometry.paper.settings import PaperSettings
from stages.photometry.stack import StackedViews
from stages.solvers.least_squares.conjugate_gradient import LinearSolution, conjugate_gradient
from stages.solvers.least_squares.reweighted_least_squares import l1_weights


def albedo_step(
    views: StackedViews,
    image: np.ndarray,
    albedo: np.ndarray,
    light: np.ndarray,
    weights: EnergyWeights,
    how: PaperSettings,
) -> LinearSolution:
    """Update all albedos by one reweighting, with the light held.

    Eq. 13: ``{ρ^i} = argmin Σ_i Σ_p w_i |I^i − ρ^i σ^i·ν^i|² + λ Σ_i Σ_p (w_∂x |∂x ρ^i|² + w_∂y |∂y ρ^i|²)
    + μ Σ_{i<j} Σ_{p^i} Σ_{p^j} C_ij w_ij |ρ^i(p^i) − ρ^j(p^j)|²``, solved as Eq. 17.

    Parameters
    ----------
    views : StackedViews
    image, albedo : ndarray, shape (N,), float64
        I and ρ^(k), at which the weights are evaluated and conjugate gradients start.
    light : ndarray, shape (n, 9), float64
        σ^(k+1).
    weights : EnergyWeights
    how : PaperSettings
        δ, and the stopping criteria of conjugate gradients.

    Notes
    -----
    Deviation 3: Eq. 13 has σ^(k), Eq. 17 σ^(k+1); the new light is used throughout, also in the weights of
    Eq. 12. The weighted squares then majorise the smoothed energy and touch it at the start of this step, so
    that the step itself, not only the whole alternation, cannot raise it.
    """
    matrix, rhs = albedo_system(views, image, albedo, light, weights, how.delta)
    return conjugate_gradient(matrix, rhs, albedo, how.cg_tolerance, how.cg_max_steps)


def albedo_system(
    views: StackedViews,
    image: np.ndarray,
    albedo: np.ndarray,
    light: np.ndarray,
    weights: EnergyWeights,
    delta: float,
) -> tuple[sp.csr_array, np.ndarray]:
    """Assemble the normal equations JᵀJ and Jᵀb of Eq. 17, with weights at `albedo` and `light`."""
    shading = views.shading(light)
    photo = l1_weights(photometric_residual(image, albedo, shading), delta)
    differences = np.concatenate(
        [
            weights.smoothness * l1_weights(views.d_x @ albedo, delta),
            weights.smoothness * l1_weights(views.d_y @ albedo, delta),
            weights.consistency * l1_weights(views.c @ albedo, delta),
        ]
    )
    return views.equations.assemble(photo * shading**2, differences), photo * shading * image
