"""Trimming of a Poisson surface to what was seen; gaps in it stay closed where no view looks through them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.settings import SurfaceGapSettings
from stages.geometry.surface import OrientedPoints, with_faces
from stages.scene.cameras import Camera, pixels_of


@dataclass(frozen=True, eq=False)
class Sightings:
    """What the views show where positions are, counted over the views.

    Attributes
    ----------
    seen : ndarray, shape (n,), int64
        Views that hold the position in their image, and no surface in front of it; depth may be unknown.
    through : ndarray, shape (n,), int64
        Of these, those that see surface behind it.
    background : ndarray, shape (n,), int64
        Of these, those that show even background there.
    """

    seen: np.ndarray
    through: np.ndarray
    background: np.ndarray


def trim_to_points(
    surface: Surface,
    points: OrientedPoints,
    reach_footprints: float,
    rim_footprints: float,
    in_background: Callable[[np.ndarray], np.ndarray],
    closed_gaps: Callable[[Surface, np.ndarray, np.ndarray], np.ndarray],
    threads: int = 1,
) -> Surface:
    """Drop surface that no points support: Poisson goes on where no view has seen any.

    Parameters
    ----------
    surface : Surface
    points : OrientedPoints
    reach_footprints : float
        Surface farther from its nearest point is dropped; of the pixels that this point was found with.
    rim_footprints : float
        So is surface farther than this before a background, from its border inwards; of the views' pixels,
        since larger ones reach beyond outlines.
    in_background : callable
        Tests whether positions, (n, 3), are seen before a background, (n,), bool.
    closed_gaps : callable
        From the surface, the vertices that are too far, (V,), bool, and how far, (V,), to those that stay
        nevertheless: `gaps_not_seen_through`.
    threads : int
        Never changes the result.
    """
    distance, nearest = cKDTree(points.x_in_world).query(surface.vertices, workers=threads)
    footprints = distance / points.footprints[nearest]
    of_own_pixels = footprints / points.pixel_sizes[nearest]
    near = of_own_pixels <= reach_footprints
    kept = near | closed_gaps(surface, ~near, of_own_pixels)
    faces = surface.faces[kept[surface.faces].all(axis=1)]
    doubtful = near & (footprints > rim_footprints)
    doubtful[doubtful] = in_background(surface.vertices[doubtful])
    rim = border_parts(faces, doubtful)
    return with_faces(Surface(surface.vertices, faces), ~rim[faces].any(axis=1))


def gaps_not_seen_through(
    surface: Surface,
    far: np.ndarray,
    footprints: np.ndarray,
    sightings_of: Callable[[np.ndarray], Sightings],
    how: SurfaceGapSettings,
) -> np.ndarray:
    """Choose, of vertices that are far from every point, those of gaps that views see and not look through.

    A gap is a part of them within the surface, with no edge on its border.

    Parameters
    ----------
    surface : Surface
        As Poisson leaves it.
    far : ndarray, shape (V,), bool
    footprints : ndarray, shape (V,)
        How far.
    sightings_of : callable
        From positions, (n, 3), to what the views show there.
    how : SurfaceGapSettings

    Returns
    -------
    ndarray, shape (V,), bool

    Notes
    -----
    What is even and enclosed has no depth of its own, and is a gap in the cloud: a panel of a door, plaster
    in the shade. Between an arm and the body is a gap, too; but there, views see what is behind.
    """
    part, at_border = _parts(surface.faces, far)
    widest = np.zeros(len(at_border))
    np.maximum.at(widest, part, footprints)
    candidates = np.flatnonzero(far & ~at_border[part] & (widest <= how.reach_footprints)[part])
    found = sightings_of(surface.vertices[candidates])
    seen, through, background = (
        np.bincount(part[candidates], counts, minlength=len(at_border))
        for counts in (found.seen, found.through, found.background)
    )
    size = np.bincount(part[candidates], minlength=len(at_border))
    closed = (size > 0) & (seen >= how.fewest_views * size)
    closed &= (through <= how.most_through * seen) & (background <= how.most_background * seen)
    return far & closed[part]


def sightings(
    x_in_world: np.ndarray,
    cameras: Sequence[Camera],
    depth_of: Callable[[Camera], np.ndarray],
    background_of: Callable[[Camera], np.ndarray | None],
    margin: float,
) -> Sightings:
    """Count what the views show where positions, (n, 3), are. A view without any depth says nothing.

    Parameters
    ----------
    x_in_world : ndarray, shape (n, 3)
    cameras : sequence of Camera
    depth_of : callable
        From a camera to its depth map, (h, w): z, 0 where unknown.
    background_of : callable
        From a camera to its even background, (h, w), bool; None where nobody said.
    margin : float
        Surface is in front, or behind, if its depth differs by more than this share of it.
    """
    seen, through, before = (np.zeros(len(x_in_world), np.int64) for _ in range(3))
    for camera in cameras:
        inside, pixel, z = pixels_of(camera, x_in_world)
        if not inside.size or not (depth_map := depth_of(camera)).any():
            continue
        depth = depth_map[pixel]
        visible = (depth == 0) | (depth >= (1 - margin) * z)
        seen[inside] += visible
        through[inside] += depth > (1 + margin) * z
        background = background_of(camera)
        if background is not None:
            before[inside] += visible & background[pixel]
    return Sightings(seen, through, before)


def before_background(
    x_in_world: np.ndarray, cameras: Sequence[Camera], background_of: Callable[[Camera], np.ndarray | None]
) -> np.ndarray:
    """Test whether any view shows background, (h, w), bool, where positions (n, 3) are; (n,), bool.

    What is behind other surface is seen where that is, not before a background. A view may have none.
    """
    found = np.zeros(len(x_in_world), bool)
    for camera in cameras:
        background = background_of(camera)
        if background is not None:
            inside, pixel, _ = pixels_of(camera, x_in_world)
            found[inside] |= background[pixel]
    return found


def border_parts(faces: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Select chosen vertices, (V,), bool, on a border of faces (F, 3), or joined to one by chosen ones."""
    part, at_border = _parts(faces, chosen)
    return chosen & at_border[part]


def _parts(faces: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number the parts, (V,), that edges between chosen vertices join; and which of them are on a border."""
    faces = faces[chosen[faces].any(axis=1)]  # no other has an edge that counts
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)).astype(np.int64)
    numbers, count = np.unique(sides[:, 0] * len(chosen) + sides[:, 1], return_counts=True)
    edges = np.stack([numbers // len(chosen), numbers % len(chosen)], axis=1)
    inside = edges[chosen[edges].all(axis=1)]
    links = sp.coo_array((np.ones(len(inside), bool), inside.T), shape=(len(chosen), len(chosen)))
    parts, part = connected_components(links, directed=False)
    ends = edges[count == 1]
    at_border = np.zeros(parts, bool)
    at_border[part[ends[chosen[ends]]]] = True
    return part, at_border
