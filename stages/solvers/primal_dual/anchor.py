"""Anchor of a Halpern epoch of `PrimalDual`: the state with which its iterations are averaged."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401

# For anchors of duals, 8 bits suffice: quantisation steps of an edge's dual, as stored, and of a pixel's.
EDGE_NOTCH, DATA_NOTCH = np.float32(256), np.float32(1 / 63)


@dataclass(frozen=True, eq=False)
class Anchor:
    """A copy of a state.

    Attributes
    ----------
    edge_dual, data_dual : ndarray of int8
        In quantisation steps, flat.
    albedo : ndarray of float32
        Flat.
    light : ndarray, shape (n, 3, K), float64
    """

    edge_dual: np.ndarray
    data_dual: np.ndarray
    albedo: np.ndarray
    light: np.ndarray

    @classmethod
    def at(
        cls, edge_dual: np.ndarray, data_dual: np.ndarray, albedo: np.ndarray, light: np.ndarray
    ) -> Anchor:
        """Copy a state, duals quantised."""
        duals = in_notches(edge_dual, EDGE_NOTCH), in_notches(data_dual.ravel(), DATA_NOTCH)
        return cls(*duals, albedo.ravel().copy(), light)


# Placeholder for plain iterations, which do not read it.
NOWHERE = Anchor(np.empty(0, np.int8), np.empty(0, np.int8), np.empty(0, np.float32), np.zeros(1))


def in_notches(values: np.ndarray, notch: np.float32) -> np.ndarray:
    """Quantise to ±127 steps, symmetrically: the duals of an edge's two ends stay negatives."""
    notches = np.empty(values.size, np.int8)
    _count(values, notch, notches)
    return notches


@numba.njit(parallel=True, cache=True, nogil=True)
def _count(values, notch, notches):
    for i in numba.prange(values.size):
        notches[i] = min(max(np.rint(np.float32(values[i]) / notch), -127), 127)
