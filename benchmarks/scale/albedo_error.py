"""Error of the albedo of a street, in figures that do not depend on which paints its bays have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.scale.photo_set import PhotoSet
from stages.formats.images.exr import read_exr

SHARED = 10  # first views, whose bays have the same paint in a street of any length


@dataclass(frozen=True)
class AlbedoError:
    """Error of the albedo after one scale per channel, of all views.

    A longer street has further paints, brighter or harder ones: its error is comparable as a part of the
    albedo, and on the bays that all streets have.

    Attributes
    ----------
    si_rmse : tuple of 3 float
        Root of the mean square (red, green, blue), in albedo.
    relative : tuple of 3 float
        The same over the root mean square of the true albedo.
    shared : tuple of 3 float
        si-RMSE of the first ten views, by the scale of all: what drifts along the street counts.
    """

    si_rmse: tuple[float, ...]
    relative: tuple[float, ...]
    shared: tuple[float, ...]


def albedo_error(photos: PhotoSet, albedo: Path) -> AlbedoError:
    """Compare a folder of EXRs with the truth, view by view: no more than one is in memory."""
    views = [moments(photos.true_albedo(file.stem), read_exr(file)) for file in sorted(albedo.glob("*.exr"))]
    return error_of(views)


def error_of(views: Sequence[np.ndarray]) -> AlbedoError:
    """Compute the error from the moments of the views, each (4, 3)."""
    all_views = np.sum(views, axis=0)
    truths, products, squares, _ = all_views
    scale = products / squares  # minimises Σ (t − a p)²
    rmse = _rmse(all_views, scale)
    shared = _rmse(np.sum(views[:SHARED], axis=0), scale)
    return AlbedoError(_listed(rmse), _listed(rmse / np.sqrt(truths / all_views[3])), _listed(shared))


def moments(truth: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Sum t², t p, p² and 1 over the pixels that both have, albedos (h, w, 3); returns (4, 3)."""
    truth, found = truth.astype(np.float64), found.astype(np.float64)
    inside = (truth > 0).all(axis=2) & (found > 0).any(axis=2)
    truth, found = truth[inside], found[inside]
    return np.stack([(truth**2).sum(0), (truth * found).sum(0), (found**2).sum(0), np.full(3, len(truth))])


def _rmse(moments: np.ndarray, scale: np.ndarray) -> np.ndarray:
    truths, products, squares, count = moments
    return np.sqrt(np.maximum(truths - 2 * scale * products + scale**2 * squares, 0) / count)


def _listed(values: Sequence[float] | np.ndarray) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
