"""Two pieces of architecture of our own: a relief wall with niches and steps, and a courtyard with a well.

Both face −y, where the courtyard is open; z is up. They are about 1 unit wide; lengths are in model units.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface
from stages.synthetic.subjects.distances import (
    arch_outline,
    box,
    extruded,
    smooth_subtraction,
    smooth_union,
    sphere,
    torus,
    upright_cylinder,
)
from stages.synthetic.subjects.isosurface import closed_surface

EDGE = 0.004  # rounding of hewn edges

# Middle, half width, springing and sill of the niches.
NICHES = ((-0.30, 0.085, 0.36, 0.15), (0.0, 0.115, 0.40, 0.11), (0.30, 0.085, 0.36, 0.15))
PILASTERS = (-0.45, -0.158, 0.158, 0.45)
NICHE_DEPTH = 0.10
STEPS = ((-0.24, 0.025), (-0.17, 0.05), (-0.10, 0.075))  # front edge, height


@dataclass(frozen=True, eq=False)
class Built:
    """A closed mesh with a part per vertex, (V,) uint8, an index into `part_names`."""

    surface: Surface
    parts: np.ndarray
    part_names: tuple[str, ...]


def build_relief(spacing: float) -> Built:
    """Mesh the wall on a grid of cells of side `spacing` (0.004: 400 k faces)."""
    low, high = np.array([-0.5717, -0.3123, -0.0431]), np.array([0.57, 0.27, 0.79])
    return _built(relief_distances, ("wall", "niches", "mouldings", "steps"), low, high, spacing)


def build_courtyard(spacing: float) -> Built:
    """Mesh the courtyard on a grid of cells of side `spacing` (0.004: 580 k faces)."""
    low, high = np.array([-0.6217, -0.4923, -0.1031]), np.array([0.62, 0.55, 0.53])
    return _built(courtyard_distances, ("ground", "back", "arcades", "well"), low, high, spacing)


def _built(
    distances: Callable[[np.ndarray], np.ndarray],
    names: tuple[str, ...],
    low: np.ndarray,
    high: np.ndarray,
    spacing: float,
) -> Built:
    surface = closed_surface(partial(_nearest, distances=distances), low, high, spacing)
    parts = distances(surface.vertices.astype(np.float32)).argmin(axis=0)
    return Built(surface, parts.astype(np.uint8), names)


def _nearest(x: np.ndarray, distances: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    return distances(x).min(axis=0)


def relief_distances(x: np.ndarray) -> np.ndarray:
    """Signed distance of wall, niches, mouldings and steps, shape (4, n), at points (n, 3).

    The lining of the niches, without their rims, belongs to the niches.
    """
    wall, holes = box(x, (-0.5, 0.0, 0.0), (0.5, 0.16, 0.70), EDGE), _niches(x)
    carved = smooth_subtraction(wall, holes, 2 * EDGE)
    inside = (holes < x.dtype.type(3 * EDGE)) & (x[:, 1] > x.dtype.type(2 * EDGE))
    far = x.dtype.type(10)
    urn = smooth_union(
        sphere(x, (0.0, 0.055, 0.275), 0.055),
        upright_cylinder(x - np.array([0, 0.055, 0], x.dtype), 0.09, 0.235, 0.030, 0.006),
        0.03,
    )
    niches = np.minimum(np.where(inside, carved, far), urn)
    return np.stack([np.where(inside, far, carved), niches, _mouldings(x, holes), _steps(x)])


def _niches(x: np.ndarray) -> np.ndarray:
    holes = []
    for middle, half_width, springing, sill in NICHES:
        outline = arch_outline(x[:, 0] - x.dtype.type(middle), x[:, 2], half_width, springing)
        outline = np.maximum(outline, x.dtype.type(sill) - x[:, 2])
        holes.append(extruded(outline, x[:, 1], -0.2, NICHE_DEPTH))
    return np.minimum.reduce(holes)


def _mouldings(x: np.ndarray, holes: np.ndarray) -> np.ndarray:
    """Bands around the arches, half columns, a cornice with dentils."""
    parts = []
    for middle, half_width, springing, sill in NICHES:
        outline = arch_outline(x[:, 0] - x.dtype.type(middle), x[:, 2], half_width, springing)
        band = np.abs(outline - x.dtype.type(0.016)) - x.dtype.type(0.012)
        band = np.maximum(band, x.dtype.type(sill) - x[:, 2])
        parts.append(extruded(band, x[:, 1], -0.016, 0.02))
    for middle in PILASTERS:
        offset = x - np.array([middle, 0.004, 0], x.dtype)
        parts += [
            upright_cylinder(offset, 0.08, 0.57, 0.026, 0.004),
            box(offset, (-0.034, -0.034, 0.05), (0.034, 0.034, 0.115), EDGE),
            box(offset, (-0.034, -0.034, 0.545), (0.034, 0.034, 0.585), EDGE),
            torus(offset, (0, 0, 0.125), (0, 0, 1), 0.026, 0.008),
        ]
    parts.append(box(x, (-0.515, -0.060, 0.62), (0.515, 0.05, 0.66), EDGE))
    parts.append(box(x, (-0.505, -0.035, 0.585), (0.505, 0.05, 0.62), EDGE))
    parts.append(_dentils(x))
    return np.maximum(np.minimum.reduce(parts), x.dtype.type(EDGE / 2) - holes)


def _dentils(x: np.ndarray, period: float = 0.04) -> np.ndarray:
    """A row of small blocks below the cornice."""
    across = x[:, 0] - x.dtype.type(period) * np.round(x[:, 0] / x.dtype.type(period))
    folded = np.stack([across, x[:, 1], x[:, 2]], axis=-1)
    row = box(folded, (-0.011, -0.052, 0.598), (0.011, 0.0, 0.625), 0.001)
    return np.maximum(row, np.abs(x[:, 0]) - x.dtype.type(0.5))


def _steps(x: np.ndarray) -> np.ndarray:
    return np.minimum.reduce(
        [box(x, (-0.5, front, 0.0), (0.5, 0.02, height), EDGE) for front, height in STEPS]
    )


def courtyard_distances(x: np.ndarray) -> np.ndarray:
    """Signed distance of ground, back wall, arcades at the sides and well, shape (4, n), at points (n, 3)."""
    ground = box(x, (-0.55, -0.42, -0.04), (0.55, 0.46, 0.0), EDGE)
    return np.stack([ground, _back_wall(x), _arcades(x), _well(x)])


def _back_wall(x: np.ndarray) -> np.ndarray:
    """A door under an arch, two steps, two windows with sills, a string course."""
    wall = box(x, (-0.55, 0.38, -0.02), (0.55, 0.46, 0.44), EDGE)
    door = extruded(arch_outline(x[:, 0], x[:, 2], 0.075, 0.17), x[:, 1], 0.3, 0.425)
    wall = smooth_subtraction(wall, door, EDGE)
    sideways = np.abs(x[:, 0]) - x.dtype.type(0.27)
    both = np.stack([sideways, x[:, 1], x[:, 2]], axis=-1)
    wall = smooth_subtraction(wall, box(both, (-0.055, 0.3, 0.19), (0.055, 0.415, 0.33)), EDGE)
    details = [
        box(both, (-0.075, 0.35, 0.165), (0.075, 0.39, 0.185), EDGE),
        box(x, (-0.54, 0.365, 0.375), (0.54, 0.39, 0.395), EDGE),
        box(x, (-0.12, 0.30, -0.01), (0.12, 0.39, 0.022), EDGE),
        box(x, (-0.10, 0.34, -0.01), (0.10, 0.39, 0.044), EDGE),
    ]
    return np.minimum.reduce([wall, *details])


def _arcades(x: np.ndarray) -> np.ndarray:
    """Walls at both sides, open in three arches each."""
    sideways = np.abs(x[:, 0])
    mirrored = np.stack([sideways, x[:, 1], x[:, 2]], axis=-1)
    wall = box(mirrored, (0.47, -0.40, -0.02), (0.53, 0.42, 0.36), EDGE)
    along = x[:, 1] + x.dtype.type(0.01)
    nearest = np.clip(np.round(along / x.dtype.type(0.25)), -1, 1) * x.dtype.type(0.25)
    opening = extruded(arch_outline(along - nearest, x[:, 2], 0.085, 0.18), sideways, 0.3, 0.7)
    opening = np.maximum(opening, x.dtype.type(0.05) - x[:, 2])
    coping = box(mirrored, (0.46, -0.41, 0.345), (0.54, 0.40, 0.37), EDGE)
    return np.minimum(smooth_subtraction(wall, opening, EDGE), coping)


def _well(x: np.ndarray) -> np.ndarray:
    """A round basin with a column and a ball in it, and a bench."""
    offset = x - np.array([-0.10, -0.03, 0.0], x.dtype)
    basin = upright_cylinder(offset, -0.01, 0.085, 0.13, EDGE)
    basin = smooth_subtraction(basin, upright_cylinder(offset, 0.03, 0.2, 0.105, EDGE), EDGE)
    column = upright_cylinder(offset, 0.0, 0.17, 0.026, EDGE)
    column = smooth_union(column, sphere(offset, (0, 0, 0.20), 0.042), 0.015)
    bench = box(x, (0.24, -0.22, 0.045), (0.32, 0.06, 0.065), EDGE)
    legs = [box(x, (0.25, y, -0.01), (0.31, y + 0.03, 0.05), EDGE) for y in (-0.20, 0.01)]
    return np.minimum.reduce([smooth_union(basin, column, 0.01), bench, *legs])
