"""Faces that a displacement turns over, and the displacement without them."""

from __future__ import annotations

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.rays import face_normals
from stages.solvers.kernels.unit_vectors import as_unit
from stages.stereo.refinement.settings import FoldSettings


def without_folds(
    surface: Surface,
    before: np.ndarray,
    directions: np.ndarray,
    heights: np.ndarray,
    settings: FoldSettings,
) -> np.ndarray:
    """Halve heights where they turn faces too far, until none is, or as often as the settings say.

    Faces turn where neighbours move by different heights; and in grooves, whose normals meet, by heights that
    are all alike, so that averages would not help.

    Parameters
    ----------
    surface : Surface
    before : ndarray, shape (F, 3), float64
        Unit normals of its faces.
    directions : ndarray, shape (V, 3), float64
        By which vertices move with a height of 1, model units.
    heights : ndarray, shape (V,), float64
    settings : FoldSettings

    Returns
    -------
    ndarray, shape (V,), float64
    """
    least_cosine = np.cos(np.deg2rad(settings.largest_turn_deg))
    for _ in range(settings.times):
        moved = surface.vertices + heights[:, None] * directions
        after = as_unit(face_normals(moved, surface.faces))
        turned = surface.faces[np.einsum("fk,fk->f", before, after) < least_cosine]
        if not len(turned):
            break
        folded = np.zeros(len(heights), bool)
        folded[turned] = True
        heights = np.where(folded, heights / 2, heights)
    return heights
