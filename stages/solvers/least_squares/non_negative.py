"""Least values of smooth functions of numbers that are not negative."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

SETTLED = 1e-5  # slope by any of the numbers at which a descent ends: further, light explains paint


def descend_above_zero(
    objective: Callable[[np.ndarray], tuple[float, np.ndarray]],
    start: np.ndarray,
    steps: int,
    settled: float = SETTLED,
) -> np.ndarray:
    """Descend from a start, of any shape and at least 0, by at most so many steps of L-BFGS-B.

    The objective gives value and slope, of the start's shape both. It ends where the slope by none of the
    numbers is more than `settled`, but for what would go below 0.
    """

    def flat(values: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = objective(values.reshape(start.shape))
        return value, slope.ravel()

    bounds = [(0.0, None)] * start.size
    found = minimize(
        flat,
        start.ravel(),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": steps, "gtol": settled},
    )
    return found.x.reshape(start.shape)
