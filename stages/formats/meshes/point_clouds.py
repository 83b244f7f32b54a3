"""Oriented, coloured point clouds as binary PLY."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline import UserError
from stages.formats.meshes.ply import Ply, read_ply, write_ply

COLUMNS = ("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue")
PIXEL_SIZE = "pixel_size"


def write_points(
    path: Path,
    x_in_world: np.ndarray,
    normals: np.ndarray,
    colours: np.ndarray,
    pixel_sizes: np.ndarray | None = None,
) -> None:
    """Write a cloud as binary PLY, creating the folder.

    Parameters
    ----------
    path : Path
    x_in_world : ndarray, shape (n, 3)
        Written as float64: in geographic coordinates float32 would be off by decimetres.
    normals : ndarray, shape (n, 3)
        Written as float32.
    colours : ndarray, shape (n, 3), uint8
    pixel_sizes : ndarray, shape (n,), uint16, or None
        Of the pixels that a point was found with, in pixels of the full size; None: nobody knows.
    """
    values = [*x_in_world.T.astype("f8"), *normals.T.astype("f4"), *colours.T.astype("u1")]
    columns = dict(zip(COLUMNS, values, strict=True))
    write_ply(path, columns if pixel_sizes is None else columns | {PIXEL_SIZE: pixel_sizes.astype("u2")})


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
    normals, colours = _normals(cloud, path), cloud.columns("red", "green", "blue")
    colours = np.zeros(normals.shape) if colours is None else colours
    with np.errstate(over="ignore", invalid="ignore"):
        return cloud.positions, normals.astype(np.float32), colours.astype(np.uint8)


def read_points(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read the finite points of a cloud with normals.

    Returns
    -------
    x_in_world : ndarray, shape (n, 3), float64
    normals : ndarray, shape (n, 3), float64
    pixel_sizes : ndarray, shape (n,), float64
        As `write_points` was given them; 1 where the file does not say.

    Raises
    ------
    UserError
        It was cut off, or has no normals.
    """
    cloud = read_ply(path)
    x_in_world, normals = cloud.positions, _normals(cloud, path)
    sizes = cloud.columns(PIXEL_SIZE)
    pixel_sizes = np.ones(len(x_in_world)) if sizes is None else sizes[:, 0]
    finite = np.isfinite(x_in_world).all(axis=1) & np.isfinite(normals).all(axis=1)
    return x_in_world[finite], normals[finite], pixel_sizes[finite]


def _normals(cloud: Ply, path: Path) -> np.ndarray:
    normals = cloud.columns("nx", "ny", "nz")
    if normals is None:
        raise UserError(f"{path} has points without normals; expected nx, ny and nz. Fuse them again.")
    return normals
