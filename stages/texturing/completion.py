"""Surface that no view shows, and what lies between charts."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import distance_transform_edt

from stages.texturing.settings import CompletionSettings
from stages.texturing.texels import Texels
from stages.texturing.unwrapping import ChartedMesh


def completed(
    texels: Texels, mesh: ChartedMesh, values: np.ndarray, seen: np.ndarray, how: CompletionSettings
) -> np.ndarray:
    """Fill unseen texels with what spreads over the surface from the seen ones.

    Parameters
    ----------
    texels : Texels
    mesh : ChartedMesh
    values : ndarray, shape (T, c), float32
    seen : ndarray, shape (T,), bool
    how : CompletionSettings

    Notes
    -----
    Vertices take the mean of the seen texels around them; the others, round by round, that of their
    neighbours: a harmonic function over the surface, chart borders or not. Parts of which nothing is seen
    take the mean of all.
    """
    if seen.all() or not seen.any():
        return values
    vertices = _harmonic(mesh, *_at_vertices(texels, mesh, values, seen), how.rounds)
    spread = texels.interpolated(mesh, vertices[mesh.original])
    return np.where(seen[:, None], values, spread)


class Gutters:
    """What lies outside all charts: it takes the nearest texel, so that no background bleeds in.

    Parameters
    ----------
    inside : ndarray, shape (s, s), bool
    """

    def __init__(self, inside: np.ndarray) -> None:
        row, column = distance_transform_edt(~inside, return_distances=False, return_indices=True)
        self._outside = np.flatnonzero(~inside)
        self._nearest = (row * inside.shape[1] + column).ravel()[self._outside]

    def fill(self, image: np.ndarray) -> np.ndarray:
        """Fill them in an image, (s, s, …), in place; returns it."""
        flat = image.reshape(-1, *image.shape[2:])
        flat[self._outside] = flat[self._nearest]
        return image


def _at_vertices(
    texels: Texels, mesh: ChartedMesh, values: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sum up seen texels at the surface's vertices: means (n, c), and whether there are any (n,)."""
    count = int(mesh.original.max()) + 1
    corners = mesh.original[mesh.faces[texels.face[seen]]]
    weights = texels.weights()[seen]
    total = np.zeros(count)
    for k in range(3):
        total += np.bincount(corners[:, k], weights[:, k], count)
    means = np.zeros((count, values.shape[1]))
    for c in range(values.shape[1]):
        of_channel = values[seen, c]
        for k in range(3):
            means[:, c] += np.bincount(corners[:, k], weights[:, k] * of_channel, count)
    known = total > 0
    return means / np.where(known, total, 1)[:, None], known


def _harmonic(mesh: ChartedMesh, values: np.ndarray, known: np.ndarray, rounds: int) -> np.ndarray:
    """Replace unknown values by means of neighbours, until all is even or after so many rounds."""
    faces, count = mesh.original[mesh.faces], len(values)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ends = np.concatenate([ends, ends[:, ::-1]])
    joined = sp.csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    values = np.where(known[:, None], values, 0)
    reached, fixed = known.astype(float), known
    for _ in range(rounds):
        around = joined @ reached
        means = (joined @ (reached[:, None] * values)) / np.maximum(around, 1)[:, None]
        new = ~fixed & (around > 0)
        values = np.where(new[:, None], means, values)
        reached = np.where(new, 1.0, reached)
    return np.where(reached[:, None] > 0, values, values[known].mean(axis=0))
