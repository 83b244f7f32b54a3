"""Cartoon of an image by TV-L1: Chambolle and Pock's primal-dual scheme, certified by its duality gap.

Le Guen, "Cartoon + Texture Image Decomposition by the TV-L1 Model", IPOL 2014, on a masked domain:

    ``min_u λ Σ_p |u(p) − g(p)| + Σ_p √((∂x u)² + (∂y u)²)``

The total variation is **isotropic**, as in that article and its program; its values lie in [0, 255], its
steps are τ = σ = 0.35, its limit 1000 iterations. Its program stops when the energy per pixel moves by less
than 0.001 in ten iterations, which a slow solver does too; here the stopping rule is the duality gap, a bound
on the excess energy. τ ten times larger and σ ten times smaller need a third of the iterations.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numba import njit


class CartoonOutcome(Enum):
    """Outcome of the iterations; the text gives advice."""

    CONVERGED = "converged: the relative duality gap is below the tolerance"
    LIMIT_REACHED = "limit reached: the duality gap is still above the tolerance; allow more iterations"


@dataclass(frozen=True)
class CartoonSettings:
    """The energy's weight, the steps and the stopping rule.

    Attributes
    ----------
    fidelity : float
        λ: the smaller, the more becomes texture. A disc of radius r pixels goes below about 2/r.
    max_iterations : int
    gap_tolerance : float
        Relative gap, (primal − dual) / primal, at which the minimum counts as reached.
        float32 attains about 1e-5.
    primal_step, dual_step : float
        τ and σ; the scheme requires ``8τσ ≤ 1``.
    gap_every : int
        Iterations between evaluations of the gap; one costs as much as about ten iterations.
    """

    fidelity: float
    max_iterations: int = 1000
    gap_tolerance: float = 1e-3
    primal_step: float = 0.35
    dual_step: float = 0.35
    gap_every: int = 50

    def __post_init__(self) -> None:
        if 8 * self.primal_step * self.dual_step > 1:
            raise ValueError(f"Steps {self.primal_step:g}, {self.dual_step:g}: expected 8τσ ≤ 1.")


@dataclass(frozen=True, eq=False)
class CartoonSolution:
    """State at the end of the iterations.

    Attributes
    ----------
    cartoon : ndarray, shape (h, w), float32
        u; 0 outside the mask.
    dual_x, dual_y : ndarray, shape (h, w), float32
        The dual field, of length ≤ 1 in every pixel; the certificate.
    energy, relative_gap : float
        ``λ|u − g| + TV(u)`` over the mask, and (energy − dual bound) / energy, computed in float64.
    iterations : int
    outcome : CartoonOutcome
    """

    cartoon: np.ndarray
    dual_x: np.ndarray
    dual_y: np.ndarray
    energy: float
    relative_gap: float
    iterations: int
    outcome: CartoonOutcome


def neighbours_within(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mark pixels that are in the mask with their neighbour to the right, or below, by 1; (h, w), float32."""
    right, below = np.zeros(mask.shape, np.float32), np.zeros(mask.shape, np.float32)
    right[:, :-1] = mask[:, :-1] & mask[:, 1:]
    below[:-1] = mask[:-1] & mask[1:]
    return right, below


@njit(cache=True, nogil=True)
def gradient(u: np.ndarray, right: np.ndarray, below: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute ``∂x u = u(x + 1) − u(x)`` and ``∂y u``, float64; 0 where the neighbour is not in the mask."""
    height, width = u.shape
    d_x, d_y = np.zeros((height, width)), np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            if right[y, x] > 0:
                d_x[y, x] = np.float64(u[y, x + 1]) - np.float64(u[y, x])
            if below[y, x] > 0:
                d_y[y, x] = np.float64(u[y + 1, x]) - np.float64(u[y, x])
    return d_x, d_y


@njit(cache=True, nogil=True)
def divergence(p_x: np.ndarray, p_y: np.ndarray, right: np.ndarray, below: np.ndarray) -> np.ndarray:
    """Apply minus the transpose of `gradient`: ``⟨∇u, p⟩ = −⟨u, div p⟩`` for all u, p; (h, w), float64."""
    height, width = p_x.shape
    result = np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            if right[y, x] > 0:
                result[y, x] += p_x[y, x]
                result[y, x + 1] -= p_x[y, x]
            if below[y, x] > 0:
                result[y, x] += p_y[y, x]
                result[y + 1, x] -= p_y[y, x]
    return result


@njit(cache=True, nogil=True)
def primal_energy(
    u: np.ndarray, g: np.ndarray, right: np.ndarray, below: np.ndarray, fidelity: float
) -> float:
    """Compute ``λ Σ |u − g| + Σ |∇u|`` in float64; u = g outside the mask."""
    d_x, d_y = gradient(u, right, below)
    data = smooth = 0.0
    for y in range(u.shape[0]):
        for x in range(u.shape[1]):
            data += abs(np.float64(u[y, x]) - np.float64(g[y, x]))
            smooth += np.sqrt(d_x[y, x] * d_x[y, x] + d_y[y, x] * d_y[y, x])
    return fidelity * data + smooth


@njit(cache=True, nogil=True)
def dual_bound(
    p_x: np.ndarray, p_y: np.ndarray, g: np.ndarray, right: np.ndarray, below: np.ndarray, fidelity: float
) -> float:
    """Compute a lower bound of the energy of all u from any p of length ≤ 1 per pixel.

    ``D(p) = Σ min_{a ≤ u ≤ b} λ|u − g| − u div p = Σ min(−g d, λ(g − a) − a d, λ(b − g) − b d)``, d = div p,
    with a and b the least and the largest g: clipping u to [a, b] raises neither term, so that a minimiser
    lies there. Without these bounds D would be −∞ wherever |d| exceeds λ by a rounding error.
    """
    d = divergence(p_x, p_y, right, below)
    low, high = np.float64(g.min()), np.float64(g.max())
    total = 0.0
    for y in range(g.shape[0]):
        for x in range(g.shape[1]):
            value, flow = np.float64(g[y, x]), d[y, x]
            lowered, raised = fidelity * (value - low) - low * flow, fidelity * (high - value) - high * flow
            total += min(-value * flow, lowered, raised)
    return total


def cartoon(image: np.ndarray, mask: np.ndarray, settings: CartoonSettings) -> CartoonSolution:
    """Minimise ``λ|u − g|₁ + TV(u)`` over the mask, from u = g and p = 0; its border costs nothing.

    Parameters
    ----------
    image : ndarray, shape (h, w), float32
        g, preferably in [0, 255], for which the steps were chosen: another scale changes only the speed.
    mask : ndarray, shape (h, w), bool
        At least one pixel.
    settings : CartoonSettings

    Notes
    -----
    ``p ← (p + σ∇ū) / max(1, |p + σ∇ū|)``; ``v = u + τ div p``;
    ``u' = g + shrink(v − g, τλ)``; ``ū = 2u' − u``. One thread, float32, no sums: the same bits everywhere.
    """
    right, below = neighbours_within(mask)
    g = np.where(mask, image, image[mask].min()).astype(np.float32)
    height, width = g.shape
    u = g.copy()
    # p has one more row above and column to the left, ū below and to the right: no loop asks for borders.
    ahead = np.pad(g, ((0, 1), (0, 1)))
    p_x, p_y = np.zeros((height, width + 1), np.float32), np.zeros((height + 1, width), np.float32)
    tau, sigma = np.float32(settings.primal_step), np.float32(settings.dual_step)
    threshold = np.float32(settings.primal_step * settings.fidelity)
    done, outcome = 0, None
    while outcome is None:
        count = min(settings.gap_every, settings.max_iterations - done)
        _iterate(u, ahead, p_x, p_y, g, right, below, tau, sigma, threshold, count)
        done += count
        energy = primal_energy(u, g, right, below, settings.fidelity)
        gap = energy - dual_bound(p_x[:, 1:], p_y[1:], g, right, below, settings.fidelity)
        relative = gap / energy if energy > 0 else 0.0
        if relative <= settings.gap_tolerance:
            outcome = CartoonOutcome.CONVERGED
        elif done >= settings.max_iterations:
            outcome = CartoonOutcome.LIMIT_REACHED
    u[~mask] = 0
    return CartoonSolution(u, p_x[:, 1:], p_y[1:], energy, relative, done, outcome)


@njit(cache=True, nogil=True, error_model="numpy")
def _iterate(u, ahead, p_x, p_y, g, right, below, tau, sigma, threshold, count):
    """Iterate `count` times in place, each one sweep.

    Row y of p needs the old ū of rows y and y + 1; row y of u needs the new p of rows y − 1 and y."""
    for _ in range(count):
        for y in range(u.shape[0]):
            _dual_row(ahead[y], ahead[y + 1], p_x[y], p_y[y + 1], right[y], below[y], sigma)
            _primal_row(u[y], ahead[y], p_x[y], p_y[y], p_y[y + 1], g[y], tau, threshold)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _dual_row(here, under, p_x, p_y, right, below, sigma):
    """Update p of one row from ū of this row and the next."""
    one = np.float32(1)
    for x in range(right.size):
        q_x = p_x[x + 1] + sigma * (here[x + 1] - here[x]) * right[x]
        q_y = p_y[x] + sigma * (under[x] - here[x]) * below[x]
        length = np.sqrt(q_x * q_x + q_y * q_y)
        shorter = one / (length if length > one else one)
        p_x[x + 1] = q_x * shorter
        p_y[x] = q_y * shorter


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _primal_row(u, ahead, p_x, above, under, g, tau, threshold):
    """Update u and ū of one row from p of this row and the one above."""
    two = np.float32(2)
    for x in range(u.size):
        flow = p_x[x + 1] - p_x[x] + under[x] - above[x]
        offset = u[x] + tau * flow - g[x]
        clipped = offset if offset < threshold else threshold
        clipped = clipped if clipped > -threshold else -threshold
        moved = g[x] + (offset - clipped)
        ahead[x] = two * moved - u[x]
        u[x] = moved
