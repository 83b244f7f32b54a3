"""Transfer vectors: occlusion of the sky from points, per harmonic, and form factors of the occluders."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from stages.photometry.paper.harmonics import real_harmonics

RAYS_AT_ONCE = 2**18  # of a thread: some 100 MB with all harmonics of the blocked rays
GOLDEN = (np.sqrt(5) - 1) / 2
PLASTIC = 0.7548776662466927  # 1 over the plastic number: consecutive vertices get dissimilar rotations


# Maps rays, as origins and unit directions, (r, 3) float32 each, to their first hit: the vertex nearest to
# it, (r,) int32, −1 where the ray leaves the scene; and whether it is hit from behind, (r,) bool.
Cast = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Occlusion:
    """Occlusion of the sky at points by a mesh, whose vertices they usually are.

    Attributes
    ----------
    blocked : ndarray, shape (P, K), float32
        ``1/π ∫ (1 − V) max(0, n·ω) Y_k(ω) dω``: deficit against ν of the open sky.
    form_factors : csr_array, shape (P, V), float32
        Row: receiver; column: vertex whose front occludes the sky. Rows sum to at most 1.
    behind : csr_array, shape (P, V), float32
        Form factors of surface that is seen from the back.
    """

    blocked: np.ndarray
    form_factors: sp.csr_array
    behind: sp.csr_array


@dataclass(frozen=True, eq=False)
class Proxy:
    """Mesh for interreflection.

    Attributes
    ----------
    positions : ndarray, shape (P, 3)
        Of its vertices, world.
    normals : ndarray, shape (P, 3)
        Unit, world axes.
    occlusion : Occlusion
        Of the sky at the vertices, by the mesh itself.
    """

    positions: np.ndarray
    normals: np.ndarray
    occlusion: Occlusion


def occlusion(
    positions: np.ndarray,
    normals: np.ndarray,
    cast: Cast,
    vertex_count: int,
    degree: int,
    directions: int,
    executor: Executor | None = None,
    after_each: Callable[[], None] = lambda: None,
) -> Occlusion:
    """Compute the occlusion of the sky at points, by rays over their hemispheres.

    Parameters
    ----------
    positions : ndarray, shape (P, 3)
        Ray origins: slightly off the surface.
    normals : ndarray, shape (P, 3)
        Unit.
    cast : callable
    vertex_count : int
        V, of the mesh that `cast` intersects.
    degree : int
        Largest l: K = (degree + 1)².
    directions : int
        Rays per point.
    executor : concurrent.futures.Executor or None
        Threads that each trace from `points_at_once` at a time; never changes the result.
    after_each : callable
        Called after every `points_at_once`.

    Notes
    -----
    Directions are distributed by the cosine (a spiral on the disc below them, rotated from point to point),
    so that each has the same share of the open sky's irradiance. Only blocked rays enter the sums: a point
    that sees the whole sky is exact.
    """
    spiral, at_once = cosine_spiral(directions), points_at_once(directions)

    def trace(begin: int) -> tuple[np.ndarray, sp.csr_array, sp.csr_array]:
        own = slice(begin, begin + at_once)
        towards = around(normals[own], spiral, np.arange(begin, begin + len(normals[own])))
        origins = np.repeat(np.asarray(positions[own], np.float32), directions, axis=0)
        vertex, behind = cast(origins, towards)
        ray = np.flatnonzero(vertex >= 0)
        vertex, behind = vertex[ray], behind[ray]
        receiver, count = ray // directions, len(normals[own])
        blocked = _sums(real_harmonics(towards[ray], degree), receiver, count) / directions
        shape = (count, vertex_count)
        fronts, backs = (
            _shares(receiver[chosen], vertex[chosen], shape, directions) for chosen in (~behind, behind)
        )
        return blocked, fronts, backs

    found = []
    for part in (map if executor is None else executor.map)(trace, range(0, len(positions), at_once)):
        found.append(part)
        after_each()
    blocked, *factors = zip(*found, strict=True)
    stacked = (sp.csr_array(sp.vstack(parts, format="csr")) for parts in factors)
    return Occlusion(np.concatenate(blocked).astype(np.float32), *stacked)


def points_at_once(directions: int) -> int:
    """Compute the number of points whose rays are cast together."""
    return max(1, RAYS_AT_ONCE // directions)


def cosine_spiral(count: int) -> np.ndarray:
    """Sample directions about +z, (count, 3), each of the same share of ``∫ cos θ dω`` of the hemisphere."""
    place = np.arange(count) + 0.5
    radius, angle = np.sqrt(place / count), 2 * np.pi * GOLDEN * place
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], axis=1)


def around(normals: np.ndarray, spiral: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Place the spiral about every normal, rotated by the vertex's number: (V · count, 3), float32."""
    first, second = tangents(normals)
    angle = 2 * np.pi * np.mod(PLASTIC * numbers, 1.0)[:, None]
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = first * cosine + second * sine, second * cosine - first * sine
    frames = np.stack([x, y, np.asarray(normals, np.float64)], axis=1)
    return (spiral @ frames).reshape(-1, 3).astype(np.float32)


def tangents(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute two unit vectors, (V, 3), in a right-handed frame with each normal (Duff et al. 2017)."""
    x, y, z = np.asarray(normals, np.float64).T
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1)
    return first, np.stack([b, sign + y * y * a, -y], axis=1)


def _sums(values: np.ndarray, receiver: np.ndarray, count: int) -> np.ndarray:
    """Sum rows by receiver, (count, K)."""
    columns = [np.bincount(receiver, values[:, k], count) for k in range(values.shape[1])]
    return np.stack(columns, axis=1)


def _shares(
    receiver: np.ndarray, vertex: np.ndarray, shape: tuple[int, int], directions: int
) -> sp.csr_array:
    share = np.full(receiver.size, 1 / directions, np.float32)
    places = receiver.astype(np.int32), vertex.astype(np.int32)  # half the memory of int64
    return sp.csr_array(sp.coo_array((share, places), shape=shape))
