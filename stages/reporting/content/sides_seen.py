"""From which sides the views see the surface, as seen from above: a statue has a back, a wall has none."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.rays import face_normals


@dataclass(frozen=True)
class SidesSeen:
    """The widest gap between the cameras around a surface, and how far the surface goes around.

    Attributes
    ----------
    gap_deg : float
        Angle at the middle of the surface, seen from above.
    between : tuple of int
        Numbers of the views at its two ends.
    roundness : float
        See `roundness`.
    """

    gap_deg: float
    between: tuple[int, int]
    roundness: float

    @classmethod
    def of(cls, surface: Surface, centres: np.ndarray, upright_from_world: np.ndarray) -> SidesSeen:
        """Look at a surface and its cameras' centres, (n, 3), world axes, from above."""
        middle = surface.vertices.mean(axis=0)
        upright = Surface((surface.vertices - middle) @ upright_from_world.T, surface.faces)
        gap_deg, between = widest_gap(((centres - middle) @ upright_from_world.T)[:, :2])
        return cls(gap_deg, between, roundness(upright))

    def as_json(self) -> dict[str, Any]:
        """Convert to plain JSON values."""
        return asdict(self)


def widest_gap(places: np.ndarray) -> tuple[float, tuple[int, int]]:
    """Find the widest angle at the origin between neighbouring places, (n, 2): °, and numbers of the two.

    Counter-clockwise from the first of the two to the second, which are the same where there is but one.
    """
    azimuth_deg = np.rad2deg(np.arctan2(places[:, 1], places[:, 0]))
    order = np.argsort(azimuth_deg)
    ends = np.roll(order, -1)
    gaps = np.mod(azimuth_deg[ends] - azimuth_deg[order], 360)
    if gaps.max() == 0:  # all stand in one direction
        gaps[-1] = 360
    widest = int(np.argmax(gaps))
    return float(gaps[widest]), (int(order[widest]), int(ends[widest]))


def roundness(surface: Surface) -> float:
    """Measure how far a surface turns outward from its own middle, z being up.

    Notes
    -----
    Mean over the surface of n·r, n the normal and r the horizontal unit direction from the middle: 1 for an
    upright cylinder, 0.85 for half of one, nearly 0 for a wall or ground with relief, below 0 for a room seen
    from inside.
    """
    normals = face_normals(surface.vertices, surface.faces)
    areas = np.linalg.norm(normals, axis=1)
    centres = surface.vertices[surface.faces].mean(axis=1)
    outward = (centres - np.average(centres, axis=0, weights=areas))[:, :2]
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    return float(np.einsum("fk,fk->", normals[:, :2], outward) / areas.sum())
