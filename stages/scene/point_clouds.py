"""Oriented, coloured point clouds as binary PLY."""

from __future__ import annotations

from pathlib import Path

import numpy as np

VERTEX = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    + [(name, "u1") for name in ("red", "green", "blue")]
)


def write_points(path: Path, x_in_world: np.ndarray, normals: np.ndarray, colours: np.ndarray) -> None:
    """Write a cloud as binary PLY, creating the folder.

    Parameters
    ----------
    path : Path
    x_in_world, normals : ndarray, shape (n, 3)
        Written as float32.
    colours : ndarray, shape (n, 3), uint8
    """
    vertices = np.empty(len(x_in_world), VERTEX)
    for columns, values in ((("x", "y", "z"), x_in_world), (("nx", "ny", "nz"), normals)):
        for axis, name in enumerate(columns):
            vertices[name] = values[:, axis]
    for axis, name in enumerate(("red", "green", "blue")):
        vertices[name] = colours[:, axis]
    kinds = {"f": "float", "u": "uchar"}
    properties = [f"property {kinds[VERTEX[name].kind]} {name}" for name in VERTEX.names]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *properties,
        "end_header",
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(("\n".join(header) + "\n").encode("ascii") + vertices.tobytes())
