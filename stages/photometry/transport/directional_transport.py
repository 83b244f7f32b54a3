"""Transport of light from many directions to points of known sky visibility."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from stages.photometry.transport.irradiance_kernels import gather_irradiance, gather_shares

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
# Of the sphere's radius: nearer to it, irradiance is unbounded; `transfer.light_distances` are 1.5 or more.
FARTHEST = np.float32(2 / 3)
AROUND = 6  # neighbours of a cell in a hexagonal grid

# Of a sparse matrix: where rows begin, columns, values.
Rows = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Sphere:
    """Sphere on which light at a finite distance originates.

    Attributes
    ----------
    centre : tuple of float
        World.
    radius : float
        Model units.
    """

    centre: tuple[float, ...]
    radius: float


def sphere_of(centre: np.ndarray, radius: float) -> Sphere | None:
    """Build the sphere of light at a distance, world and model units; None for infinity."""
    return Sphere(tuple(centre), radius) if np.isfinite(radius) else None


def offsets_in(sphere: Sphere | None, positions: np.ndarray) -> np.ndarray:
    """Express positions (N, 3) relative to the sphere's centre, in radii, float32; 0 for infinity.

    Points near the sphere or beyond, as of a wide ground, are moved to two thirds of its radius.
    """
    if sphere is None:
        return np.zeros(positions.shape, np.float32)
    offsets = ((positions - np.array(sphere.centre)) / sphere.radius).astype(np.float32)
    length = np.linalg.norm(offsets, axis=1, keepdims=True)
    return offsets * np.minimum(1, FARTHEST / np.maximum(length, FARTHEST))


def arriving(normals: np.ndarray, offsets: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Compute irradiance from small sources in directions on the unit sphere, facing its centre.

    As the loops do: at points (n, 3) from directions (k, 3), nothing in between; (n, k), float32.
    """
    received = np.einsum("nk,nk->n", normals, offsets)[:, None]
    received = normals @ directions.T - received
    sent = np.maximum(1 - offsets @ directions.T, 0)
    squared = 1 - 2 * (offsets @ directions.T) + np.einsum("nk,nk->n", offsets, offsets)[:, None]
    return (np.maximum(received, 0) * sent / squared**2).astype(np.float32)


def even_directions(count: int) -> np.ndarray:
    """Distribute unit vectors evenly over the sphere on a spiral, from the zenith (+z) down, (count, 3)."""
    place = np.arange(count) + 0.5
    z, angle = 1 - 2 * place / count, GOLDEN_ANGLE * place
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def axes_across(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Build two unit vectors at right angles to each direction and to each other, (n, 3) each."""
    aside = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    one = np.cross(directions, aside)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return one, np.cross(directions, one)


def honeycomb(directions: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Place six directions, (6 n, 3), around each given one, (n, 3), at the spacing of cells of that size.

    A hexagonal cell of solid angle ``4π c`` has the width ``√(2/√3 · 4π c)``.
    """
    directions = directions.astype(np.float64)
    width = np.sqrt(2 / np.sqrt(3) * 4 * np.pi * cells.astype(np.float64))[:, None, None]
    one, other = axes_across(directions)
    turn = 2 * np.pi * np.arange(AROUND)[None, :, None] / AROUND
    off = np.cos(turn) * one[:, None] + np.sin(turn) * other[:, None]
    return (np.cos(width) * directions[:, None] + np.sin(width) * off).reshape(-1, 3).astype(np.float32)


@dataclass(frozen=True, eq=False)
class DirectionalTransport:
    """Direct transport of light from M directions to N points: visibility times cosine.

    Attributes
    ----------
    normals : ndarray, shape (N, 3), float32
        Unit, world axes.
    offsets : ndarray, shape (N, 3), float32
        Of `offsets_in`.
    blend : csr_array, shape (N, P), float32
        Every point as a blend of vertices; one without vertices sees the whole sky.
    visible : ndarray, shape (P, ⌈M/8⌉), uint8
        Of `sky_visibility.visible_directions`.
    directions : ndarray, shape (M, 3), float32
    cells : ndarray, shape (M,), float32
        Solid angle of each direction as a share of the sphere; sums to 1, suns apart.
    traced : ndarray, shape (N, k), uint8
        Visibility of the last k directions, the suns, from the points themselves, in 255ths.

    Notes
    -----
    ``S(p) = 1/π ∫ V L max(0, n·ω) dω ≈ 4 Σ_d c_d V_d(p) max(0, n_p·ω_d) L_d``, c the cells: the shading of
    Eq. 1, with all frequencies of the light that M directions resolve. V is interpolated between vertices,
    but for suns, whose shadows have sharp edges; the cosine is the point's own. Light from a finite sphere
    comes from small sources that face its centre: it varies with position, by the angle and the inverse
    square of the distance.
    """

    normals: np.ndarray
    offsets: np.ndarray
    blend: sp.csr_array
    visible: np.ndarray
    directions: np.ndarray
    cells: np.ndarray
    traced: np.ndarray

    @classmethod
    def of(
        cls, normals: np.ndarray, offsets: np.ndarray, blend: sp.csr_array, visible: np.ndarray, count: int
    ) -> DirectionalTransport:
        """Build the transport to points with unit normals (N, 3) from `count` directions of equal cells."""
        directions, cells = even_directions(count).astype(np.float32), np.full(count, 1 / count, np.float32)
        normals, no_suns = np.ascontiguousarray(normals, np.float32), np.zeros((len(normals), 0), np.uint8)
        return cls(normals, offsets, blend, visible, directions, cells, no_suns)

    def at(self, points: np.ndarray) -> DirectionalTransport:
        """Select some of the points."""
        return replace(
            self,
            normals=self.normals[points],
            offsets=self.offsets[points],
            blend=self.blend[points],
            traced=self.traced[points],
        )

    def shares(self, points: np.ndarray) -> np.ndarray:
        """Compute the shading of chosen points per unit of radiance from each direction, (n, M), float32."""
        out = np.empty((len(points), len(self.directions)), np.float32)
        where = self.normals, self.offsets, self._blend, self.visible, self.traced
        gather_shares(np.asarray(points), *where, self.directions, out)
        out *= self._weight
        return out

    def shading(self, radiance: np.ndarray, points: slice = slice(None)) -> np.ndarray:
        """Compute the direct shading of a range of points under light (M, 3): (·, 3), float32."""
        first, vertex, weight = self._blend
        begin, end, _ = points.indices(len(self.normals))
        out = np.empty((max(0, end - begin), 3), np.float32)
        own = (first[begin : end + 1], vertex, weight)
        light = np.ascontiguousarray(radiance * self._weight[:, None], np.float32)
        where = self.normals[begin:end], self.offsets[begin:end], own, self.visible, self.traced[begin:end]
        gather_irradiance(*where, self.directions, light, out)
        return out

    @property
    def geometry(self) -> tuple[np.ndarray, np.ndarray, Rows, np.ndarray, np.ndarray]:
        """Arguments common to all loops over chosen points."""
        return self.normals, self.offsets, self._blend, self.visible, self.directions

    @property
    def _weight(self) -> np.ndarray:
        return 4 * self.cells

    @property
    def _blend(self) -> Rows:
        blend = self.blend
        return blend.indptr, blend.indices, blend.data
