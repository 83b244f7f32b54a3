"""A scan on a floor of two triangles, beside a box of ten: large faces and occlusion."""

from __future__ import annotations

from os import getpid
from pathlib import Path

import numpy as np

from stages.formats.meshes.mesh_files import read_mesh_file
from stages.formats.meshes.triangle_meshes import Surface, write_mesh
from stages.synthetic.subjects.subject import mesh_subject

OF_THE_SCAN = np.array([(0.35, 0.35, 0.35), (0.6, 0.25, 0.2), (0.5, 0.5, 0.45), (0.2, 0.3, 0.5)])  # linear
OF_THE_FLOOR, OF_THE_BOX = (0.6, 0.45, 0.3), (0.25, 0.4, 0.6)
FLOOR, BOX, ASIDE = 1.8, 0.3, 0.45  # sides, and where the box begins, in heights of the scan

# Corners of a face by the axes, counter-clockwise seen from outside; y is up. None below: the floor is there.
SQUARES = np.array(
    [
        [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
        [(1, 0, 0), (0, 0, 0), (0, 1, 0), (1, 1, 0)],
        [(1, 0, 1), (1, 0, 0), (1, 1, 0), (1, 1, 1)],
        [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)],
        [(0, 1, 1), (1, 1, 1), (1, 1, 0), (0, 1, 0)],
    ]
)


def write_on_a_floor(scan: Path, to: Path) -> None:
    """Write the scan, y up, in four materials, with floor and box; squares share no vertex."""
    subject = mesh_subject(read_mesh_file(scan))
    vertices = subject.surface.vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    height, middle = high[1] - low[1], (low + high) / 2
    foot = np.array([middle[0], low[1], middle[2]])
    floor = foot + height * FLOOR * (SQUARES[4:] - [0.5, 1, 0.5])
    box = foot + height * (BOX * SQUARES + [ASIDE, 0, 0.1])
    squares = np.concatenate([floor, box]).reshape(-1, 3)
    corners = len(vertices) + np.arange(len(squares)).reshape(-1, 4)
    faces = np.concatenate([subject.surface.faces, corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    paints = [OF_THE_SCAN[subject.parts], np.tile(OF_THE_FLOOR, (4, 1)), np.tile(OF_THE_BOX, (20, 1))]
    surface = Surface(np.concatenate([vertices, squares]), faces.astype(np.int32))
    own = to.with_suffix(f".{getpid()}.ply")  # another benchmark may be reading what is there
    write_mesh(own, surface, np.concatenate(paints))
    own.replace(to)
