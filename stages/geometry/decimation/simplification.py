"""Quadric decimation by `fast_simplification`; imports little, since a new process does for every mesh."""

from __future__ import annotations

import fast_simplification
import numpy as np

from pipeline.process.own_process import in_own_process

FEW_FACES = 200_000  # of which 56 MB stay: a process takes longer to begin than such a mesh


def simplified(
    vertices: np.ndarray, faces: np.ndarray, count: int, aggressiveness: float
) -> tuple[np.ndarray, np.ndarray]:
    """Decimate vertices (V, 3) and faces (F, 3) to about so many faces.

    The library keeps 280 MB for every million faces of its largest mesh until its process ends: a large one
    is given a process of its own.
    """
    if len(faces) <= FEW_FACES:
        return _simplified(vertices, faces, count, aggressiveness)
    return in_own_process("that decimates a mesh", _simplified, vertices, faces, count, aggressiveness)


def _simplified(
    vertices: np.ndarray, faces: np.ndarray, count: int, aggressiveness: float
) -> tuple[np.ndarray, np.ndarray]:
    return fast_simplification.simplify(vertices, faces, target_count=count, agg=aggressiveness)
