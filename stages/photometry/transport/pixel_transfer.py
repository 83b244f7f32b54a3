"""Shading basis of pixels with visibility of the sky and interreflection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from stages.photometry.paper.harmonics import shading_basis
from stages.photometry.transport.interreflection import bounced
from stages.photometry.transport.transfer_vectors import Occlusion, Proxy
from stages.solvers.kernels.sparse_rows import product

WHITEST = 0.95  # upper bound of reflectance, for interreflection to converge; also the bound of `brightest`


@dataclass(frozen=True)
class Bounces:
    """Parameters of interreflection.

    Attributes
    ----------
    count : int
        Number of interreflections; 0: none.
    brightest : float
        Assumed reflectance of the brightest material, which images do not determine, in its brightest
        channel. Under coloured light the others are underestimated by as much.
    quantile : float
        Quantile of all albedo values that counts as the brightest material.
    """

    count: int
    brightest: float
    quantile: float


@dataclass(frozen=True, eq=False)
class PixelTransfer:
    """Transfer ν of Eq. 1 for N pixels that interpolate the visibility of P vertices.

    Attributes
    ----------
    open_sky : ndarray, shape (N, K), float32
        ν of the pixels' own normals under the unoccluded sky.
    blend : csr_array, shape (N, P), float32
        Every pixel as a blend of vertices; rows sum to 1, or to 0 where the back of the mesh is seen.
    occlusion : Occlusion
        Of the vertices, K harmonics.
    vertex_sky : ndarray, shape (P, K), float32
        ν of the vertices' normals.
    nearest : ndarray, shape (P,)
        Of `nearest_shown`.
    """

    open_sky: np.ndarray
    blend: sp.csr_array
    occlusion: Occlusion
    vertex_sky: np.ndarray
    nearest: np.ndarray

    @classmethod
    def of(
        cls,
        normals: np.ndarray,
        blend: sp.csr_array,
        proxy: Proxy,
        degree: int,
    ) -> tuple[PixelTransfer, int]:
        """Build the transfer for harmonics up to a degree; pixels' normals, (N, 3), are unit, world axes.

        Pixels' normals face the camera, vertices' normals point out of the mesh. Where the two are opposed
        the back of the mesh is seen, whose visibility is unknown: such pixels are taken to see the whole sky,
        and counted.
        """
        occlusion, size = proxy.occlusion, (degree + 1) ** 2
        blend, opposed = without_opposed(normals, blend, proxy.normals)
        transfer = cls(
            open_sky=shading_basis(normals, degree).astype(np.float32),
            blend=blend,
            occlusion=Occlusion(occlusion.blocked[:, :size], occlusion.form_factors, occlusion.behind),
            vertex_sky=shading_basis(proxy.normals, degree).astype(np.float32),
            nearest=nearest_shown(blend, proxy.positions),
        )
        return transfer, opposed

    def direct(self) -> np.ndarray:
        """Compute the pixels' transfer from the sky itself, (N, K), float32."""
        return self.open_sky - self.blend @ self.occlusion.blocked

    def with_bounces(self, albedo: np.ndarray, bounces: Bounces) -> np.ndarray:
        """Compute the pixels' transfer with interreflection, channel by channel.

        Parameters
        ----------
        albedo : ndarray, shape (N, 3)
            On any scale.
        bounces : Bounces

        Returns
        -------
        ndarray, shape (N, K, 3), float32
        """
        absolute = np.minimum(on_absolute_scale(albedo, bounces.brightest, bounces.quantile), WHITEST)
        direct, of_vertices = self.direct(), self.vertex_sky - self.occlusion.blocked
        basis = np.empty((*direct.shape, albedo.shape[1]), np.float32)
        for c in range(albedo.shape[1]):
            values, typical = self.at_vertices(absolute[:, c]), float(np.median(absolute[:, c]))
            there = bounced(
                of_vertices, self.occlusion, values[:, None].astype(np.float32), typical, bounces.count
            )
            basis[:, :, c] = direct + product(self.blend, (there - of_vertices).astype(np.float32))
        return basis

    def at_vertices(self, values: np.ndarray) -> np.ndarray:
        """Average pixel values at the vertices; see the function `at_vertices`."""
        return at_vertices(self.blend, self.nearest, values)


def at_vertices(blend: sp.csr_array, nearest: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Average pixel values, (N,), around every vertex, or the shown one `nearest` to it: (P,)."""
    weight = blend.sum(axis=0)
    means = (blend.T @ values) / np.where(weight > 0, weight, 1)
    return np.where(weight > 0, means, np.median(values))[nearest]


def nearest_shown(blend: sp.csr_array, positions: np.ndarray) -> np.ndarray:
    """Find the nearest vertex that some pixel shows, for every vertex, (P,): itself, if it is shown.

    Most vertices of a mesh finer than the pixels lie between them, and some surface is seen by no view; all
    of it takes part in interreflection.

    Parameters
    ----------
    blend : csr_array, shape (N, P)
        Pixels as blends of the vertices. Where it is empty, every vertex is its own nearest.
    positions : ndarray, shape (P, 3)
    """
    shown = np.zeros(len(positions), bool)
    shown[blend.indices] = True
    return nearest_of(shown, positions)


def nearest_of(shown: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Find the nearest of the shown vertices, (P,) bool, for every vertex: itself, if none is shown."""
    nearest = np.arange(len(positions))
    if shown.any():
        _, place = cKDTree(positions[shown]).query(positions[~shown])
        nearest[~shown] = nearest[shown][place]
    return nearest


def without_opposed(
    normals: np.ndarray, blend: sp.csr_array, vertex_normals: np.ndarray
) -> tuple[sp.csr_array, int]:
    """Clear the blend of pixels that see the back of the mesh, and count these pixels."""
    facing = np.einsum("pk,pk->p", normals, blend @ vertex_normals) > 0
    kept = sp.csr_array(sp.diags_array(facing.astype(np.float32)) @ blend)
    kept.eliminate_zeros()
    return kept, int(np.count_nonzero(~facing))


def on_absolute_scale(albedo: np.ndarray, brightest: float, quantile: float) -> np.ndarray:
    """Scale albedo by one factor, clipped at 0, to a given reflectance of the brightest material.

    The brightest material is a quantile of all values.
    """
    return np.maximum(albedo * to_absolute_scale(albedo, brightest, quantile), 0.0)


def to_absolute_scale(albedo: np.ndarray, brightest: float, quantile: float) -> float:
    """Compute that factor; 0 where all is black."""
    bright = float(np.quantile(albedo, quantile)) if albedo.size else 0.0
    return brightest / bright if bright > 0 else 0.0
