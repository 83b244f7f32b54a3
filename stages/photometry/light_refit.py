"""The light step compiled: all views and channels in one pass over the pixels."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.threading_layer  # noqa: F401

BLOCK = 4096  # pixels summed by one thread; the order of the sums does not depend on the threads


class ViewBlocks:
    """Runs of at most `BLOCK` pixels of one view each: the shares of work of the loops below.

    Parameters
    ----------
    starts : ndarray, shape (n + 1,), int64
        View i owns the pixels ``starts[i]:starts[i + 1]``.
    """

    def __init__(self, starts: np.ndarray):
        views, begins = [], []
        for view in range(len(starts) - 1):
            own = np.arange(starts[view], starts[view + 1], BLOCK)
            views.append(np.full(own.size, view))
            begins.append(own)
        self.views = np.concatenate(views)
        self.begins = np.concatenate(begins)
        self.ends = np.minimum(self.begins + BLOCK, np.asarray(starts)[self.views + 1])


def refit_light(
    blocks: ViewBlocks,
    basis: np.ndarray,
    image: np.ndarray,
    albedo: np.ndarray,
    light: np.ndarray,
    delta: float,
) -> np.ndarray:
    """One reweighting of all lights with the albedo held, as `light_step` does it, for three channels.

    Parameters
    ----------
    blocks : ViewBlocks
    basis : ndarray, shape (N, K), float32
    image, albedo : ndarray, shape (N, 3), float32
    light : ndarray, shape (n, 3, K), float64
        Where the weights are taken.
    delta : float

    Returns
    -------
    ndarray, shape (n, 3, K), float64
    """
    size = basis.shape[1]
    grams = np.zeros((blocks.views.size, 3, size, size))
    sums = np.zeros((blocks.views.size, 3, size))
    _sums(blocks.views, blocks.begins, blocks.ends, basis, image, albedo, light, delta, grams, sums)
    fitted = np.zeros_like(light)
    for view in range(light.shape[0]):
        own = blocks.views == view
        gram, right = grams[own].sum(axis=0), sums[own].sum(axis=0)
        for channel in range(3):
            whole = gram[channel] + np.triu(gram[channel], 1).T
            fitted[view, channel] = np.linalg.pinv(whole, rcond=1e-14, hermitian=True) @ right[channel]
    return fitted


def shading_of(blocks: ViewBlocks, basis: np.ndarray, light: np.ndarray) -> np.ndarray:
    """σ·ν of all pixels and channels, shape (N, 3), float32; arguments as in `refit_light`."""
    shading = np.empty((basis.shape[0], 3), np.float32)
    _shade(blocks.views, blocks.begins, blocks.ends, basis, light.astype(np.float32), shading)
    return shading


@numba.njit(parallel=True, cache=True, nogil=True)
def _shade(views, begins, ends, basis, light, shading):
    for block in numba.prange(views.size):
        sigma = light[views[block]]
        for p in range(begins[block], ends[block]):
            for c in range(3):
                total = np.float32(0)
                for k in range(basis.shape[1]):
                    total += basis[p, k] * sigma[c, k]
                shading[p, c] = total


@numba.njit(parallel=True, cache=True, nogil=True)
def _sums(views, begins, ends, basis, image, albedo, light, delta, grams, sums):
    """Upper triangles of the weighted Gram matrices and right-hand sides of every block."""
    size = basis.shape[1]
    for block in numba.prange(views.size):
        sigma, gram, right = light[views[block]], grams[block], sums[block]
        for p in range(begins[block], ends[block]):
            for c in range(3):
                shading = 0.0
                for k in range(size):
                    shading += basis[p, k] * sigma[c, k]
                rho = np.float64(albedo[p, c])
                weight = rho / max(abs(image[p, c] - rho * shading), delta)
                for k in range(size):
                    scaled = weight * basis[p, k]
                    right[c, k] += scaled * image[p, c]
                    for j in range(k, size):
                        gram[c, k, j] += scaled * rho * basis[p, j]
