"""Diffuse interreflection between surfaces."""

from __future__ import annotations

import numpy as np

from stages.photometry.transport.transfer_vectors import Occlusion
from stages.solvers.kernels.sparse_rows import product


def bounced(
    direct: np.ndarray, seen: Occlusion, albedo: np.ndarray, of_backs: float | np.ndarray, bounces: int
) -> np.ndarray:
    """Compute transfer, or shading, with interreflection.

    ``t(X) = t_direct(X) + 1/π ∫ (1 − V) max(0, n·ω) ρ(q) t(q) dω``, q the point hit along ω

    Parameters
    ----------
    direct : ndarray, shape (V, K)
        Open sky's ν less `Occlusion.blocked`.
    seen : Occlusion
    albedo : ndarray, shape (V, 1) or (V, K)
        ρ, on the absolute scale: within [0, 1).
    of_backs : float or ndarray, shape (K,)
        ρ of surface that is hit from behind; its irradiance is taken to be that of its front.
    bounces : int
        Number of interreflections. The truncation error is at most ``ρ^(bounces + 1)`` of the total, ρ the
        largest albedo.

    Returns
    -------
    ndarray, shape (V, K)
    """
    total = direct
    for _ in range(bounces):
        total = direct + product(seen.form_factors, albedo * total) + of_backs * product(seen.behind, total)
    return total
