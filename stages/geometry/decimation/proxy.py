"""A decimated mesh in place of a large one, and interpolation from it to the large one's vertices."""

from __future__ import annotations

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface, joined
from stages.geometry.decimation.simplification import simplified
from stages.geometry.occluders import nearest_faces, scene_of
from stages.geometry.settings import ProxySettings
from stages.geometry.short_edges import ShortEdged, with_short_edges
from stages.geometry.surface import decimated, mean_edge


def short_edged_with_proxy(
    mesh: Surface, longest_edge: float, most_vertices: int, settings: ProxySettings
) -> tuple[ShortEdged, Surface]:
    """Cut long edges of a mesh; return it, and its proxy: itself, or a decimation of it.

    A mesh is decimated if it had more than `most_vertices` before it was cut. Decimation leaves large faces
    where all is flat: they are cut as well. Cutting adds `extra_vertices` at most.

    Parameters
    ----------
    mesh : Surface
    longest_edge : float
        Model units.
    most_vertices : int
    settings : ProxySettings
    """
    more = 1 + settings.extra_vertices
    short = with_short_edges(mesh, longest_edge, int(more * max(len(mesh.vertices), most_vertices)))
    whole = welded(short.surface)
    if len(whole.vertices) <= most_vertices or (short.cuts and len(welded(mesh).vertices) <= most_vertices):
        return short, whole
    small = roughly_decimated(whole, faces_of_fewer_vertices(whole, most_vertices), settings)
    return short, with_short_edges(small, short.longest, int(more * most_vertices)).surface


def roughness_of(mesh: Surface, proxy: Surface, longest_edge: float) -> float:
    """Measure how coarse the facets are that occlude each other, as the length of an edge.

    Halves of a face have the slope of the whole, so cutting makes nothing smoother: it is the mean edge of
    the mesh as it was, or of its proxy if that is longer, but no more than edges of large flat faces were
    cut to.
    """
    return min(max(mean_edge(mesh), mean_edge(proxy)), longest_edge)


def roughly_decimated(surface: Surface, faces: int, settings: ProxySettings) -> Surface:
    """Decimate a surface to about so many faces, within a small part of its edges.

    Quadric decimation under a bound that rises: of all edges the next below it goes, not the cheapest one.
    That is six times as fast as `stages.geometry.surface.decimated` (fountain: 3 s), as near in the mean, and
    leaves flat floors faces of even size instead of slivers; open borders fray by some edges. Where too many
    are left below the highest bound, the other goes on.
    """
    middle, unit = surface.vertices.mean(axis=0), settings.unit_edges * mean_edge(surface)
    vertices, corners = simplified(
        (surface.vertices - middle) / unit, surface.faces, faces, settings.aggressiveness
    )
    small = decimated(Surface(vertices, corners.astype(np.int32)), faces)
    return Surface(small.vertices * unit + middle, small.faces)


def faces_of_fewer_vertices(surface: Surface, vertices: int) -> int:
    """Estimate how many faces leave about so many vertices, at as many faces per vertex as now.

    Two of a closed mesh, fewer where there are holes and borders.
    """
    return max(1, len(surface.faces) * vertices // max(len(surface.vertices), 1))


def welded(surface: Surface) -> Surface:
    """Join vertices and drop faces that have become lines: otherwise nothing could be decimated."""
    whole, _ = joined(surface)
    if whole is surface:
        return surface
    collapsed = (whole.faces == np.roll(whole.faces, 1, axis=1)).any(axis=1)
    return Surface(whole.vertices, whole.faces[~collapsed])


def blend_of(
    surface: Surface, normals: np.ndarray, proxy: Surface, settings: ProxySettings, threads: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Blend every vertex of the surface from the corners of the proxy's nearest face.

    Parameters
    ----------
    surface : Surface
    normals : ndarray, shape (V, 3)
        Its vertices'. Of a thin sheet the nearest face may be that of the other side: there, the one
        nearest to a point above the vertex is taken.
    proxy : Surface
    settings : ProxySettings
        `sheet_offset`, how far above.
    threads : int
        0: all.

    Returns
    -------
    tuple of ndarray, shape (V, 3), int32, and ndarray, shape (V, 3), float32
        Vertices of the proxy and their weights, which sum to 1.
    """
    count = len(surface.vertices)
    if proxy is surface:
        own = np.repeat(np.arange(count, dtype=np.int32)[:, None], 3, axis=1)
        return own, np.tile(np.array([1, 0, 0], np.float32), (count, 1))
    scene, origin = scene_of(proxy, threads)
    points = (surface.vertices - origin).astype(np.float32)
    faces, weights, facing = nearest_faces(scene, points, normals)
    if not facing.all():
        offset = settings.sheet_offset * mean_edge(proxy)
        above = points[~facing] + offset * normals[~facing].astype(np.float32)
        faces[~facing], weights[~facing], _ = nearest_faces(scene, above, normals[~facing])
    return proxy.faces[faces].astype(np.int32), weights
