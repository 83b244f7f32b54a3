"""Minimisation of smooth functions of non-negative variables."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize


def descend_above_zero(
    objective: Callable[[np.ndarray], tuple[float, np.ndarray]],
    start: np.ndarray,
    steps: int,
    settled: float,
) -> np.ndarray:
    """Minimise over values of at least 0, from a start of any shape, by at most `steps` steps of L-BFGS-B.

    The objective returns its value and its gradient, of the start's shape. The descent ends when no component
    of the projected gradient exceeds `settled`.
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
