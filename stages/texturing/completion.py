"""Surface that no view shows, and what lies between charts."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import distance_transform_edt

from stages.texturing.settings import CompletionSettings
from stages.texturing.texels import Texels
from stages.texturing.unwrapping import ChartedMesh


class SurfaceMeans:
    """Means of what is seen around each vertex of a surface, gathered texture by texture.

    Parameters
    ----------
    mesh : ChartedMesh
        All of it, whatever its textures.
    """

    def __init__(self, mesh: ChartedMesh) -> None:
        count = int(mesh.original.max(initial=-1)) + 1
        self._mesh = mesh
        self._weight, self._sums = np.zeros(count), np.zeros((count, 1))

    def add(self, texels: Texels, part: ChartedMesh, values: np.ndarray, seen: np.ndarray) -> None:
        """Add the seen texels, of values (T, c), of a part of the mesh."""
        corners = part.original[part.faces[texels.face[seen]]]
        self._sums = self._sums + np.zeros(values.shape[1])
        weights = texels.weights()[seen]
        for k in range(3):
            self._weight += np.bincount(corners[:, k], weights[:, k], len(self._weight))
            for c, channel in enumerate(values[seen].T):
                self._sums[:, c] += np.bincount(corners[:, k], weights[:, k] * channel, len(self._weight))

    def spread(self, how: CompletionSettings) -> np.ndarray:
        """Compute values of the mesh's vertices, (V, c), where nothing is seen by what is around.

        Notes
        -----
        Vertices take the mean of the seen texels around them; the others, round by round, that of their
        neighbours: a harmonic function over the surface, chart borders or not. Parts of which nothing is seen
        take the mean of all.
        """
        known = self._weight > 0
        if not known.any():
            return np.zeros((len(self._mesh.vertices), self._sums.shape[1]))
        means = self._sums / np.where(known, self._weight, 1)[:, None]
        return _harmonic(self._mesh, means, known, how.rounds)[self._mesh.original]


def completed(
    texels: Texels, part: ChartedMesh, values: np.ndarray, seen: np.ndarray, at_vertices: np.ndarray
) -> np.ndarray:
    """Fill unseen texels, of values (T, c), with those of the vertices around: see `SurfaceMeans.spread`."""
    if seen.all():
        return values
    filled, unseen = values.copy(), ~seen
    filled[unseen] = texels.at(unseen).interpolated(part, at_vertices)
    return filled


class Gutters:
    """What lies outside all charts: it takes the nearest texel, so that no background bleeds in.

    Parameters
    ----------
    inside : ndarray, shape (s, s), bool
    """

    def __init__(self, inside: np.ndarray) -> None:
        row, column = distance_transform_edt(~inside, return_distances=False, return_indices=True)
        self._outside = np.flatnonzero(~inside)
        row *= inside.shape[1]  # of 32 bits each, as the place of a texel is
        row += column
        self._nearest = row.ravel()[self._outside]

    def fill(self, image: np.ndarray) -> np.ndarray:
        """Fill them in an image, (s, s, …), in place; returns it."""
        flat = image.reshape(-1, *image.shape[2:])
        flat[self._outside] = flat[self._nearest]
        return image


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
