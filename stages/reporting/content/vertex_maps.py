"""The surface for the page: a mesh of few vertices, each with what the views show there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.formats.images.photos import encode_srgb8
from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.decimation.proxy import faces_of_fewer_vertices, roughly_decimated, welded
from stages.geometry.rays import face_normals, vertex_normals
from stages.geometry.short_edges import with_short_edges
from stages.geometry.surface import mean_edge
from stages.reporting.settings import SurfaceSettings
from stages.scene.cameras import Camera, smallest_footprints
from stages.texturing.gathering import Sums, ViewMaps, gather

PHOTO, SHADING, CONFIDENCE, MAPS = slice(0, 3), slice(3, 6), 6, 7  # of what is gathered, besides the albedo
UNSEEN = 128  # grey of vertices that no view shows


@dataclass(frozen=True, eq=False)
class SmallSurface:
    """A mesh of few vertices, its normals, and the view-dependent sums at its vertices.

    Attributes
    ----------
    surface : Surface
    normals : ndarray, shape (V, 3), float32
    origin : ndarray, shape (3,)
        The middle of its vertices.
    sums : Sums
        What the views show, so far.
    typical : float
        The median footprint of a pixel, model units.
    """

    surface: Surface
    normals: np.ndarray
    origin: np.ndarray
    sums: Sums
    typical: float

    @classmethod
    def of(cls, mesh: Surface, cameras: list[Camera], how: SurfaceSettings) -> SmallSurface:
        """Decimate a mesh where it has too many vertices, then cut its long edges: colours are of vertices.

        Where all is flat, decimation leaves large faces, whatever is painted on them.
        """
        whole = welded(mesh)
        some = whole.vertices[:: max(1, len(whole.vertices) // how.footprint_vertices)]
        seen = smallest_footprints(some, cameras)
        seen = seen[np.isfinite(seen)]
        typical = float(np.median(seen)) if len(seen) else mean_edge(whole)
        fewer = int(how.most_vertices / (1 + how.proxy.extra_vertices))
        if len(whole.vertices) > how.most_vertices:
            whole = roughly_decimated(whole, faces_of_fewer_vertices(whole, fewer), how.proxy)
        solid = np.linalg.norm(face_normals(whole.vertices, whole.faces), axis=1) > 0
        small = Surface(whole.vertices, whole.faces[solid])
        small = with_short_edges(small, typical, how.most_vertices).surface
        origin = small.vertices.mean(axis=0)
        normals = vertex_normals(small.vertices - origin, small.faces).astype(np.float32)
        return cls(small, normals, origin, Sums.none(len(small.vertices), MAPS), typical)

    def add(self, view: ViewMaps, how: SurfaceSettings) -> np.ndarray:
        """Add what a view shows; `view.maps`: photo, shading, confidence, (h, w, 7).

        Returns
        -------
        ndarray, shape (T,), float32
            The view's albedo at some vertices, evenly chosen, mean of its channels; 0 where it shows none.
        """
        own = Sums.none(len(self.surface.vertices), MAPS)
        points = (self.surface.vertices - self.origin).astype(np.float32)
        nothing = np.zeros((0, 3), np.float32)
        scale = (self.typical, 1.0)
        gather(points, self.normals, view, nothing, scale, self.origin, how.gathering, own)
        self.sums.add(own)
        some = slice(None, None, max(1, len(points) // how.compared_vertices))
        weight = own.weight[some]
        return own.albedo[some].mean(axis=1) / np.where(weight > 0, weight, 1)


def colours_as_bytes(small: SmallSurface, albedo_white: float, how: SurfaceSettings) -> bytes:
    """Lay out what vertices show: albedo, photo, shading (V, 3), sRGB, then confidence (V,); all uint8."""
    albedo, further = small.sums.into_means()
    seen = small.sums.weight > 0
    colours = [
        encode_srgb8(values / max(white, 1e-12))
        for values, white in (
            (albedo, albedo_white),
            (further[:, PHOTO], bright(further[seen, PHOTO], how)),
            (further[:, SHADING], bright(further[seen, SHADING], how)),
        )
    ]
    for codes in colours:
        codes[~seen] = UNSEEN
    confidence = np.rint(further[:, CONFIDENCE].clip(0, 1) * 255).astype("<u1")
    return b"".join(block.tobytes() for block in (*colours, confidence))


def bright(values: np.ndarray, how: SurfaceSettings) -> float:
    """Find the value that is white in colours, (n, 3)."""
    quantile = float(np.quantile(values.max(axis=1), how.bright_quantile)) if len(values) else 1.0
    return max(quantile, 1e-12)
