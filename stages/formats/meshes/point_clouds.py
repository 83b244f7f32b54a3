"""Oriented, coloured point clouds as binary PLY."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stages.formats.meshes.ply import write_ply

COLUMNS = ("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue")


def write_points(path: Path, x_in_world: np.ndarray, normals: np.ndarray, colours: np.ndarray) -> None:
    """Write a cloud as binary PLY, creating the folder.

    Parameters
    ----------
    path : Path
    x_in_world, normals : ndarray, shape (n, 3)
        Written as float32.
    colours : ndarray, shape (n, 3), uint8
    """
    values = [*x_in_world.T.astype("f4"), *normals.T.astype("f4"), *colours.T.astype("u1")]
    write_ply(path, dict(zip(COLUMNS, values, strict=True)))
