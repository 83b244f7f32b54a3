"""Least values of smooth functions of numbers that are not negative."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

# Slope by any number, times how many there are, at which a descent ends: the more lights share a loss, the
# less it changes by each. What is pulled less may stay where it began, and does well to: with an eighth of
# this, light that is found by pairs explains some paint (docs/transfer.md).
SETTLED = 0.0077


def descend_above_zero(
    objective: Callable[[np.ndarray], tuple[float, np.ndarray]], start: np.ndarray, steps: int
) -> np.ndarray:
    """Descend from a start, of any shape and at least 0, by at most so many steps of L-BFGS-B.

    The objective gives value and slope, of the start's shape both. The value is a mean of some kind.
    """

    def flat(values: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = objective(values.reshape(start.shape))
        return value, slope.ravel()

    bounds = [(0.0, None)] * start.size
    options = {"maxiter": steps, "gtol": SETTLED / max(start.size, 1)}
    found = minimize(flat, start.ravel(), jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    return found.x.reshape(start.shape)
