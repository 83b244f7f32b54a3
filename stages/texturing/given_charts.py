"""Charts that a mesh was given with: its own texture coordinates, materials and UDIM tiles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pipeline import UserError
from stages.formats.meshes.polygons import Polygons, UVMap, triangulate
from stages.formats.meshes.textured_models import ObjCorners
from stages.formats.meshes.triangle_meshes import Surface, joined
from stages.texturing.settings import GivenUVSettings
from stages.texturing.texels import areas_in_texture
from stages.texturing.unwrapping import ChartedMesh, normals_of

FIRST_UDIM, UDIM_COLUMNS, UDIM_ROWS = 1001, 10, 100
TILE_ROUNDING = 1e-4  # by which an exporter's rounding may carry a corner over the border of its tile


@dataclass(frozen=True, eq=False)
class Chart:
    """Faces that share a texture: those of one material in one UDIM tile.

    Attributes
    ----------
    material : str
    tile : int
        By its UDIM number; that of the first tile as well where a texture is repeated.
    faces : ndarray, shape (f,), int64
    """

    material: str
    tile: int
    faces: np.ndarray


@dataclass(frozen=True, eq=False)
class GivenCharts:
    """A given mesh with its own charts.

    Attributes
    ----------
    mesh : ChartedMesh
        All triangles of the file, in its order; vertices of different textures are different, and `uv` is
        that within the tile.
    charts : tuple of Chart
    obj : ObjCorners
        The polygons of the file, with normals.
    """

    mesh: ChartedMesh
    charts: tuple[Chart, ...]
    obj: ObjCorners


def given_charts(
    surface: Surface, polygons: Polygons, uv_map: UVMap, settings: GivenUVSettings
) -> GivenCharts:
    """Arrange a given mesh by textures, with the normals of the surface that was made of it.

    Parameters
    ----------
    surface : Surface
        Of the same triangles, in the same order; those with two corners in one place may be missing.
    polygons : Polygons
    uv_map : UVMap
    settings : GivenUVSettings

    Raises
    ------
    UserError
        There are more textures than `most_textures`, or their faces lie on one another, or repeat them, more
        than `most_layers` times.
    """
    places = polygons.vertices[polygons.corners]
    corners = triangulate(Polygons(places, polygons.sizes, np.arange(len(places))))
    vertex = _vertices_of_corners(surface, places[corners])
    downwards = uv_map.with_v(upwards=False)
    chart_of_polygon, names, shift = _charts_of_polygons(polygons, uv_map)
    if len(names) > settings.most_textures:
        raise UserError(
            f"The mesh has {len(names)} textures, by material and UDIM tile; expected at most "
            f"{settings.most_textures}. Join materials, raise texture.given_uv.most_textures, or set "
            "texture.given_uv.keep=false for charts of our own."
        )
    chart = np.repeat(chart_of_polygon, polygons.sizes - 2)
    uv = downwards[uv_map.corners[corners]] + shift[chart][:, None]
    areas = areas_in_texture(uv)
    _check_layers(uv, areas, chart, names, settings.most_layers)
    label = 2 * chart + (areas < 0)  # tangents turn over where charts are mirrored
    mesh, normals = _parted_by_chart(surface, vertex, uv_map.corners[corners], uv, label)
    normal_of_corner = np.zeros(len(places), np.int64)
    normal_of_corner[corners] = vertex
    obj = ObjCorners(
        polygons.vertices,
        uv_map.with_v(upwards=True),
        normals,
        polygons.sizes,
        np.stack([polygons.corners, uv_map.corners, normal_of_corner], axis=1),
        chart_of_polygon,
    )
    charts = (Chart(*name, np.flatnonzero(chart == number)) for number, name in enumerate(names))
    return GivenCharts(mesh, tuple(charts), obj)


def _vertices_of_corners(surface: Surface, places: np.ndarray) -> np.ndarray:
    """Find the surface's vertex of each triangle's corners, (f, 3), by the order that both have.

    Of triangles that the surface lacks, for their corners are in one place, the nearest vertices.
    """
    there = np.ones(len(places), bool)
    if len(surface.faces) != len(places):
        there = (places != np.roll(places, 1, axis=1)).any(axis=2).all(axis=1)
    if int(there.sum()) != len(surface.faces) or (surface.vertices[surface.faces] != places[there]).any():
        raise ValueError("the surface was not made of this mesh")
    vertex = np.empty(places.shape[:2], np.int64)
    vertex[there] = surface.faces
    if not there.all():
        vertex[~there] = cKDTree(surface.vertices).query(places[~there])[1]
    return vertex


def _charts_of_polygons(
    polygons: Polygons, uv_map: UVMap
) -> tuple[np.ndarray, list[tuple[str, int]], np.ndarray]:
    """Assign polygons to textures.

    A material is divided into UDIM tiles if each of its faces lies in one; else its texture is repeated.

    Returns
    -------
    chart : ndarray, shape (f,)
        Of each polygon.
    names : list of (material, tile)
    shift : ndarray, shape (charts, 2)
        To be added to `uv`, v downwards, for coordinates within the tile.
    """
    first = np.cumsum(polygons.sizes) - polygons.sizes
    used = uv_map.with_v(upwards=True)[uv_map.corners]
    low, high = np.minimum.reduceat(used, first), np.maximum.reduceat(used, first)
    middle = (low + high) / 2
    tile = np.where(
        middle == 0, 0, np.ceil(middle) - 1
    )  # a face on the border is of the tile that ends there
    within = (low >= tile - TILE_ROUNDING) & (high <= tile + 1 + TILE_ROUNDING)
    fits = within.all(axis=1) & (tile >= 0).all(axis=1) & (tile < (UDIM_COLUMNS, UDIM_ROWS)).all(axis=1)
    repeats = np.bincount(uv_map.material[~fits], minlength=len(uv_map.materials)) > 0
    tile[repeats[uv_map.material]] = 0
    number = (tile[:, 0] + UDIM_COLUMNS * tile[:, 1]).astype(np.int64)
    kinds, chart = np.unique(uv_map.material * (UDIM_COLUMNS * UDIM_ROWS) + number, return_inverse=True)
    material, number = np.divmod(kinds, UDIM_COLUMNS * UDIM_ROWS)
    rows, columns = np.divmod(number, UDIM_COLUMNS)
    names = [(uv_map.materials[m], FIRST_UDIM + int(n)) for m, n in zip(material, number, strict=True)]
    return chart.reshape(-1), names, np.stack([-columns, rows], axis=1).astype(np.float64)


def _check_layers(
    uv: np.ndarray, areas: np.ndarray, chart: np.ndarray, names: list[tuple[str, int]], most: float
) -> None:
    layers = np.bincount(chart, np.abs(areas), minlength=len(names))
    np.maximum.at(layers, chart, np.ptp(uv, axis=1).max(axis=1))
    worst = int(layers.argmax())
    if layers[worst] > most:
        raise UserError(
            f"The texture coordinates of material {names[worst][0]!r} cover their texture "
            f"{layers[worst]:.3g} times; expected at most {most:g}, for a texture that repeats has no place "
            "for the albedo of each of its copies. Unwrap the mesh without repeating, or set "
            "texture.given_uv.keep=false for charts of our own."
        )


def _parted_by_chart(
    surface: Surface, vertex: np.ndarray, uv_row: np.ndarray, uv: np.ndarray, label: np.ndarray
) -> tuple[ChartedMesh, np.ndarray]:
    """Make a vertex of each combination of place, texture coordinate and label of faces.

    In the order of the texture coordinates, which is that of the vertices of a GLB. Also returns the normals
    of the surface's vertices.
    """
    pair = uv_row.astype(np.int64) * len(surface.vertices) + vertex
    _, number = np.unique(pair, return_inverse=True)
    keys = number.reshape(-1, 3) * (int(label.max(initial=0)) + 1) + label[:, None]
    _, first, faces = np.unique(keys, return_index=True, return_inverse=True)
    normals, (_, original) = normals_of(surface), joined(surface)
    chosen = vertex.reshape(-1)[first]
    mesh = ChartedMesh(
        surface.vertices[chosen],
        normals[chosen],
        faces.reshape(-1, 3).astype(np.int32),
        uv.reshape(-1, 2)[first],
        original[chosen],
    )
    return mesh, normals
