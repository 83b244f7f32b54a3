"""Scenes under light from one distance: transport to pixels and vertices, and interreflection."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from stages.formats.artefacts.transfer_file import StoredTransfer
from stages.photometry.transport.directional_transport import (
    DirectionalTransport,
    Sphere,
    offsets_in,
    sphere_of,
)
from stages.photometry.transport.pixel_transfer import nearest_shown, without_opposed
from stages.photometry.transport.shown_radiance import ShownRadiance
from stages.photometry.transport.sky_visibility import VisibilityProbes
from stages.photometry.transport.transfer_vectors import Occlusion, Proxy


@dataclass(frozen=True, eq=False)
class LitScene:
    """Pixels and proxy vertices under light from one distance.

    Attributes
    ----------
    pixels : DirectionalTransport
        N, of all views.
    vertices : DirectionalTransport
        P; of the proxy's positions and normals.
    proxy : Proxy
        Mesh of P vertices for interreflection.
    sphere : Sphere or None
        Sphere of the light, world; None: at infinity.
    probes : VisibilityProbes or None
        Of the vertices, for visibility in further directions.
    shown : ShownRadiance or None
        Of the vertices, for interreflection, where photos of more views than these in the same light show it.
    """

    pixels: DirectionalTransport
    vertices: DirectionalTransport
    proxy: Proxy
    sphere: Sphere | None = None
    probes: VisibilityProbes | None = None
    shown: ShownRadiance | None = None

    @classmethod
    def of(
        cls,
        normals: np.ndarray,
        blend: sp.csr_array,
        proxy: Proxy,
        visible: np.ndarray,
        directions: int,
        sphere: Sphere | None,
    ) -> LitScene:
        """Build a scene of pixels, normals (N, 3), that blend proxy vertices; see `DirectionalTransport`."""
        own = sp.csr_array(sp.eye_array(len(proxy.positions), dtype=np.float32, format="csr"))
        of_vertices = offsets_in(sphere, proxy.positions)
        return cls(
            pixels=DirectionalTransport.of(normals, blend @ of_vertices, blend, visible, directions),
            vertices=DirectionalTransport.of(proxy.normals, of_vertices, own, visible, directions),
            proxy=proxy,
            sphere=sphere,
        )

    def with_pixels(self, normals: np.ndarray, blend: sp.csr_array, traced: np.ndarray) -> LitScene:
        """Replace the pixels: normals (N, 3), blend of vertices (N, P), visibility of the suns (N, k)."""
        offsets = blend @ offsets_in(self.sphere, self.proxy.positions)
        normals = np.ascontiguousarray(normals, np.float32)
        there = {"normals": normals, "offsets": offsets, "blend": blend, "traced": traced}
        return replace(self, pixels=replace(self.pixels, **there))

    @property
    def suns(self) -> np.ndarray:
        """Directions of the suns, (k, 3): the last ones."""
        directions = self.pixels.directions
        return directions[len(directions) - self.pixels.traced.shape[1] :]

    def at(self, pixels: np.ndarray) -> LitScene:
        """Select some of the pixels."""
        return replace(self, pixels=self.pixels.at(pixels))

    def places(self, pixels: np.ndarray) -> np.ndarray:
        """Interpolate surface points of chosen pixels, (n, 3), world axes, relative to the vertices' mean.

        Not a number where a pixel blends no vertices: it sees the back of the mesh.
        """
        blend = self.pixels.blend[pixels]
        where = blend @ (self.proxy.positions - self.proxy.positions.mean(axis=0))
        where[np.diff(blend.indptr) == 0] = np.nan
        return where

    @cached_property
    def nearest_shown(self) -> np.ndarray:
        """Nearest shown vertex of every vertex, (P,); see the function `nearest_shown`."""
        return nearest_shown(self.pixels.blend, self.proxy.positions)

    @cached_property
    def to_vertices(self) -> sp.csr_array:
        """Blend weights of the pixels around every vertex, (P, N)."""
        return self.pixels.blend.T.tocsr()


def proxy_in(stored: StoredTransfer) -> Proxy:
    """Build the proxy mesh, whose vertices the pixels blend."""
    seen = Occlusion(stored.blocked, stored.form_factors, stored.behind)
    return Proxy(stored.vertices, stored.normals, seen)


def scenes_by_distance(
    stored: StoredTransfer, blend: sp.csr_array, normals: np.ndarray, probes: VisibilityProbes | None = None
) -> tuple[list[LitScene], int]:
    """Build a scene per stored radius, in that order; count the pixels that see the back of the mesh.

    Parameters
    ----------
    stored : StoredTransfer
    blend : csr_array, shape (N, P)
    normals : ndarray, shape (N, 3)
        Of the pixels.
    probes : VisibilityProbes or None
        Of the proxy's vertices, for visibility in other directions than the stored ones.
    """
    blend, opposed = without_opposed(normals, blend, stored.normals)
    proxy, scenes = proxy_in(stored), []
    for radius, visible in zip(stored.radii.tolist(), stored.visible, strict=True):
        sphere = sphere_of(stored.centre, radius)
        scene = LitScene.of(normals, blend, proxy, visible, int(stored.directions), sphere)
        scenes.append(replace(scene, probes=probes))
    return scenes, opposed
