"""Oriented, coloured point clouds as binary PLY."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline import UserError
from stages.formats.meshes.ply import read_ply, write_ply

COLUMNS = ("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue")


def write_points(path: Path, x_in_world: np.ndarray, normals: np.ndarray, colours: np.ndarray) -> None:
    """Write a cloud as binary PLY, creating the folder.

    Parameters
    ----------
    path : Path
    x_in_world : ndarray, shape (n, 3)
        Written as float64: in geographic coordinates float32 would be off by decimetres.
    normals : ndarray, shape (n, 3)
        Written as float32.
    colours : ndarray, shape (n, 3), uint8
    """
    values = [*x_in_world.T.astype("f8"), *normals.T.astype("f4"), *colours.T.astype("u1")]
    write_ply(path, dict(zip(COLUMNS, values, strict=True)))


def read_cloud(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read a cloud with normals, and its colours if it has any.

    Returns
    -------
    x_in_world : ndarray, shape (n, 3), float64
    normals : ndarray, shape (n, 3), float32
    colours : ndarray, shape (n, 3), uint8
        Black where the file has none.

    Raises
    ------
    UserError
        It was cut off, or has no normals.
    """
    cloud = read_ply(path)
    normals, colours = cloud.columns("nx", "ny", "nz"), cloud.columns("red", "green", "blue")
    if normals is None:
        raise UserError(f"{path} has points without normals; expected nx, ny and nz. Fuse them again.")
    colours = np.zeros(normals.shape) if colours is None else colours
    with np.errstate(over="ignore", invalid="ignore"):
        return cloud.positions, normals.astype(np.float32), colours.astype(np.uint8)
