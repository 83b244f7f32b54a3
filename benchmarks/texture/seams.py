"""Steps of a texture across the borders of charts, beside those across lines inside charts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.occluders import nearest_faces, scene_of
from stages.texturing.rendering import texture_at
from stages.texturing.texels import texels_of
from stages.texturing.unwrapping import ChartedMesh

ASIDE = 1.0  # texels, between a line and where the texture is looked up on either side of it
DARK = 0.02  # of white, added before logarithms
OUTSIDE = -1  # of all charts
LEAST_LINES = 1000  # drawn at random


@dataclass(frozen=True)
class Steps:
    """Mean steps of the logarithm of albedo over two texels' distance.

    Attributes
    ----------
    border, inside : float
        Across chart borders; across random lines as long, inside charts.
    surface : float
        Across chart borders as `border`, of what the views show of the surface there, without an atlas: what
        is there if nothing is wrong with the texture.
    border_places, inside_places : int
        How many were measured, about a texel apart.
    """

    border: float
    inside: float
    surface: float
    border_places: int
    inside_places: int


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines of a surface in the atlas, n of them, which have a place there on either side.

    Attributes
    ----------
    begin, end : ndarray, shape (2, n, 2)
        In texels; the same point of the surface on both sides.
    away : ndarray, shape (2, n, 2)
        Unit, across the line, into that side.
    """

    begin: np.ndarray
    end: np.ndarray
    away: np.ndarray


# Maps points of the surface and their unit normals, (m, 3) float32 each, world axes, points from the mean of
# the mesh's vertices, to what the views show there: albedo, (m, 3), and whether any does, (m,).
Shown = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def steps_of(
    mesh: ChartedMesh,
    atlas: np.ndarray,
    seen: np.ndarray,
    white: float,
    shown: Shown,
    rng: np.random.Generator,
) -> Steps:
    """Measure the steps across all chart borders and across random lines of their lengths.

    Parameters
    ----------
    mesh : ChartedMesh
    atlas : ndarray, shape (s, s, 3), float32
        Linear albedo.
    seen : ndarray, shape (s, s), bool
        Only steps between such texels count.
    white : float
    shown : callable
    rng : Generator
    """
    side, charts = len(atlas), chart_image(mesh, len(atlas))
    borders = chart_borders(mesh, side)
    lengths = np.linalg.norm(borders.end[0] - borders.begin[0], axis=1)
    lines = random_lines(charts, np.resize(lengths, max(LEAST_LINES, len(lengths))), rng)
    usable = seen & (charts != OUTSIDE)
    at_border, at_line = places_aside(borders, usable), places_aside(lines, usable)
    column, row = np.moveaxis(at_line.astype(int), 2, 0)
    at_line = at_line[:, charts[row[0], column[0]] == charts[row[1], column[1]]]
    points, normals = on_surface(mesh, side, at_border)
    one, other = (shown(points[k], normals[k]) for k in range(2))
    known = one[1] & other[1]
    return Steps(
        step(*texture_at(atlas, at_border / side), white),
        step(*texture_at(atlas, at_line / side), white),
        step(one[0][known], other[0][known], white),
        at_border.shape[1],
        at_line.shape[1],
    )


def step(one: np.ndarray, other: np.ndarray, white: float) -> float:
    """Compute the mean difference of the logarithms of two albedos, (m, 3); nan where there are none."""
    logarithms = [np.log(np.maximum(albedo, 0) / white + DARK) for albedo in (one, other)]
    return float(np.abs(logarithms[0] - logarithms[1]).mean()) if len(one) else float("nan")


def chart_image(mesh: ChartedMesh, side: int) -> np.ndarray:
    """Number the charts of all texels, (side, side), int32; `OUTSIDE` between them."""
    texels = texels_of(mesh, side)
    count = len(mesh.vertices)
    one, other = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]]]).T
    joined = sp.coo_array((np.ones(len(one), bool), (one, other)), shape=(count, count))
    _, of_vertex = sp.csgraph.connected_components(joined, directed=False)
    return texels.image(of_vertex[mesh.faces[texels.face, 0]].astype(np.int32), OUTSIDE)


def chart_borders(mesh: ChartedMesh, side: int) -> Lines:
    """List the edges that two faces share on the surface but not in the atlas."""
    ends = np.concatenate([mesh.faces[:, [0, 1, 2]], mesh.faces[:, [1, 2, 0]], mesh.faces[:, [2, 0, 1]]])
    turned = mesh.original[ends[:, 0]] > mesh.original[ends[:, 1]]
    ends[turned, :2] = ends[turned, 1::-1]  # equal ends first on both sides
    first, second = mesh.original[ends[:, 0]], mesh.original[ends[:, 1]]
    order = np.lexsort((second, first))
    same = (np.diff(first[order]) == 0) & (np.diff(second[order]) == 0)
    pairs = np.stack([order[:-1][same], order[1:][same]])
    apart = (ends[pairs[0], :2] != ends[pairs[1], :2]).any(axis=1)
    begin, end, third = (mesh.uv[ends[pairs[:, apart], k]] * side for k in range(3))
    return Lines(begin, end, _across(end - begin, third - begin))


def random_lines(charts: np.ndarray, lengths: np.ndarray, rng: np.random.Generator) -> Lines:
    """Draw a line of each length, (n,) texels: its middle a random texel of a chart, any direction."""
    row, column = np.nonzero(charts != OUTSIDE)
    drawn = rng.integers(0, len(row), len(lengths))
    middle = np.column_stack([column[drawn], row[drawn]]) + 0.5
    angle = rng.uniform(0, 2 * np.pi, len(lengths))
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    begin, end = (middle + sign * lengths[:, None] / 2 * along for sign in (-1, 1))
    away = np.column_stack([-along[:, 1], along[:, 0]])
    return Lines(np.stack([begin, begin]), np.stack([end, end]), np.stack([away, -away]))


def places_aside(lines: Lines, usable: np.ndarray) -> np.ndarray:
    """List places on either side of lines, about a texel apart along them, (2, m, 2), in texels.

    Those of which a side is beyond the atlas or not in a usable texel, (s, s) bool, are left out.
    """
    lengths = np.linalg.norm(lines.end[0] - lines.begin[0], axis=1)
    places = np.maximum(np.rint(lengths), 1).astype(int)
    line = np.repeat(np.arange(len(places)), places)
    number = np.arange(len(line)) - np.repeat(np.cumsum(places) - places, places)
    share = ((number + 0.5) / places[line])[None, :, None]
    at = (1 - share) * lines.begin[:, line] + share * lines.end[:, line] + ASIDE * lines.away[:, line]
    at = at[:, ((at >= 0) & (at < len(usable))).all(axis=(0, 2))]
    column, row = np.moveaxis(at.astype(int), 2, 0)
    return at[:, usable[row, column].all(axis=0)]


def on_surface(mesh: ChartedMesh, side: int, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the points of the surface at places of the atlas, (2, m, 2): points from the vertices' mean.

    Returns
    -------
    tuple of two ndarray, shape (2, m, 3), float32
        Points and normals: of the face that is nearest in the atlas.
    """
    flat = np.concatenate([mesh.uv * side, np.zeros((len(mesh.uv), 1))], axis=1)
    scene, origin = scene_of(Surface(flat, mesh.faces))
    places = np.concatenate([at.reshape(-1, 2), np.zeros((at[..., 0].size, 1))], axis=1) - origin
    faces, weights, _ = nearest_faces(scene, places.astype(np.float32), np.zeros_like(places))
    corners = mesh.faces[faces]
    centred = mesh.vertices - mesh.vertices.mean(axis=0)
    points, normals = (
        np.einsum("mk,mkc->mc", weights, values[corners]).astype(np.float32).reshape(*at.shape[:2], 3)
        for values in (centred, mesh.normals)
    )
    return points, normals


def _across(along: np.ndarray, inwards: np.ndarray) -> np.ndarray:
    """Compute unit vectors perpendicular to lines, (2, n, 2), on the side that other vectors point to."""
    away = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    away /= np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), np.finfo(float).tiny)
    return away * np.where((away * inwards).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
