"""The light step compiled: all views and channels in one pass over the pixels."""

from __future__ import annotations

import numba
import numpy as np

import stages.solvers.threading_layer  # noqa: F401

CHUNK = 256  # pixels whose columns stay in the nearest cache, so that every product is a vector's
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
    _sums(
        blocks.views,
        blocks.begins,
        blocks.ends,
        basis,
        image,
        albedo,
        light,
        delta,
        grams,
        sums,
    )
    by_view = [np.flatnonzero(blocks.views == view) for view in range(light.shape[0])]
    upper = np.stack([grams[own].sum(axis=0) for own in by_view])
    right = np.stack([sums[own].sum(axis=0) for own in by_view])
    gram = upper + np.triu(upper, 1).swapaxes(-1, -2)
    return np.einsum("vckl,vcl->vck", np.linalg.pinv(gram, rcond=1e-14, hermitian=True), right)


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


@numba.njit(parallel=True, cache=True, nogil=True, fastmath=True, error_model="numpy")
def _sums(views, begins, ends, basis, image, albedo, light, delta, grams, sums):
    """Upper triangles of the weighted Gram matrices and right-hand sides of every block."""
    for block in numba.prange(views.size):
        columns = np.empty((basis.shape[1], CHUNK))
        shading, weight, target = np.empty((3, CHUNK))
        for begin in range(begins[block], ends[block], CHUNK):
            count = min(CHUNK, ends[block] - begin)
            for i in range(count):
                for k in range(basis.shape[1]):
                    columns[k, i] = basis[begin + i, k]
            for c in range(3):
                _shade_columns(columns, light[views[block], c], count, shading)
                for i in range(count):
                    rho, value = np.float64(albedo[begin + i, c]), np.float64(image[begin + i, c])
                    pull = rho / max(abs(value - rho * shading[i]), delta)
                    weight[i], target[i] = pull * rho, pull * value
                _add_products(columns, weight, target, count, shading, grams[block, c], sums[block, c])


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _shade_columns(columns, light, count, shading):
    """``Σ_k light_k columns_k`` of the first `count` pixels of a chunk."""
    shading[:count] = 0.0
    for k in range(columns.shape[0]):
        for i in range(count):
            shading[i] += light[k] * columns[k, i]


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _add_products(columns, weight, target, count, scratch, gram, right):
    """Add a chunk's weighted products of columns.

    In float64: a wall has one normal, and its Gram matrix one direction that means something, which rounding
    would drown among eight that do not.
    """
    for k in range(columns.shape[0]):
        total = 0.0
        for i in range(count):
            total += target[i] * columns[k, i]
            scratch[i] = weight[i] * columns[k, i]
        right[k] += total
        for j in range(k, columns.shape[0]):
            total = 0.0
            for i in range(count):
                total += scratch[i] * columns[j, i]
            gram[k, j] += total
