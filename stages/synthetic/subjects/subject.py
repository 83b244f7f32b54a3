"""What stands before the cameras: bust, relief, courtyard, or any mesh, with its parts and its size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface
from stages.synthetic.subjects.architecture import build_courtyard, build_relief
from stages.synthetic.subjects.bust import NARROW, PARTS, build_bust

Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # rows: the world's x, y, z from the mesh's x, y, z


@dataclass(frozen=True, eq=False)
class Subject:
    """A surface divided into parts.

    Attributes
    ----------
    surface : Surface
    parts : ndarray, shape (V,), uint8
        Index into `part_names`.
    part_names : tuple of str
    """

    surface: Surface
    parts: np.ndarray
    part_names: tuple[str, ...]

    @property
    def centre(self) -> np.ndarray:
        """Middle of the bounding box, shape (3,)."""
        return (self.surface.vertices.min(axis=0) + self.surface.vertices.max(axis=0)) / 2

    @property
    def radius(self) -> float:
        """Half the diagonal of the bounding box, model units."""
        return self.surface.diagonal / 2


def bust_subject(spacing: float) -> Subject:
    """The bust in its four parts; see `build_bust` for `spacing`."""
    bust = build_bust(spacing, slab=NARROW)
    return Subject(bust.surface, bust.parts, PARTS)


def built_subject(name: str, spacing: float) -> Subject:
    """Build one of our own subjects by its name: bust, relief, courtyard."""
    if name == "bust":
        return bust_subject(spacing)
    built = {"relief": build_relief, "courtyard": build_courtyard}[name](spacing)
    return Subject(built.surface, built.parts, built.part_names)


def mesh_subject(surface: Surface, parts: int = 4, y_up: bool = False) -> Subject:
    """Any mesh, divided into the surroundings of `parts` points that lie far from one another.

    Parameters
    ----------
    surface : Surface
    parts : int
        1 to 255; the first surrounds the highest vertex.
    y_up : bool
        Whether the mesh has y upwards and faces +z; it is turned so that z is up and it faces −y.
    """
    vertices = surface.vertices @ Y_UP.T if y_up else surface.vertices
    nearest = np.full(len(vertices), np.inf)
    owner = np.zeros(len(vertices), np.uint8)
    seed = int(vertices[:, 2].argmax())
    for part in range(parts):
        distance = np.linalg.norm(vertices - vertices[seed], axis=1)
        owner[distance < nearest] = part
        nearest = np.minimum(nearest, distance)
        seed = int(nearest.argmax())
    return Subject(Surface(vertices, surface.faces), owner, tuple(f"part{k + 1}" for k in range(parts)))
