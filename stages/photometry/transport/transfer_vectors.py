"""Transfer vectors: how much of the sky's light reaches a point past what stands in it, per harmonic."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from stages.photometry.paper.harmonics import real_harmonics

RAYS_AT_ONCE = 2**18  # of a thread: some 100 MB with all harmonics of those that are blocked
GOLDEN = (np.sqrt(5) - 1) / 2
PLASTIC = 0.7548776662466927  # 1 over the plastic number: turns of neighbouring vertices far from each other


# Rays, as origins and unit directions, (r, 3) float32 each, to what they meet first: the vertex nearest to
# it, (r,) int32, −1 where the ray leaves the scene; and whether it is met from behind, (r,) bool.
Cast = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Occlusion:
    """What stands between points and the sky: the vertices of a mesh, as a rule their own.

    Attributes
    ----------
    blocked : ndarray, shape (P, K), float32
        ``1/π ∫ (1 − V) max(0, n·ω) Y_k(ω) dω``: what a point lacks of the open sky's ν.
    form_factors : csr_array, shape (P, V), float32
        Row: receiver; column: the vertex whose front it sees instead. Rows sum to at most 1.
    behind : csr_array, shape (P, V), float32
        The same for surface that it sees from the back.
    """

    blocked: np.ndarray
    form_factors: sp.csr_array
    behind: sp.csr_array


@dataclass(frozen=True, eq=False)
class Proxy:
    """A mesh that light goes on by.

    Attributes
    ----------
    positions : ndarray, shape (P, 3)
        Of its vertices, world.
    normals : ndarray, shape (P, 3)
        Unit, world axes.
    seen : Occlusion
        What they see of each other instead of the sky.
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
    """Look from every point into its half of all directions.

    Parameters
    ----------
    positions : ndarray, shape (P, 3)
        Where rays begin: a little off the surface.
    normals : ndarray, shape (P, 3)
        Unit.
    cast : callable
    vertex_count : int
        V, of the mesh that `cast` knows.
    degree : int
        Largest l: K = (degree + 1)².
    directions : int
        Rays per point.
    executor : concurrent.futures.Executor or None
        Threads that look from `points_at_once` at a time; never changes the result.
    after_each : callable
        Called after every `points_at_once`.

    Notes
    -----
    Directions are spread by the cosine's weight (a spiral on the disc below them, turned from point to
    point), so that each of them stands for the same share of the open sky's irradiance. Only those that are
    blocked enter the sums: a point that sees the whole sky is exact.
    """
    spiral, at_once = cosine_spiral(directions), points_at_once(directions)

    def look(begin: int) -> tuple[np.ndarray, sp.csr_array, sp.csr_array]:
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
    for part in (map if executor is None else executor.map)(look, range(0, len(positions), at_once)):
        found.append(part)
        after_each()
    blocked, *factors = zip(*found, strict=True)
    stacked = (sp.csr_array(sp.vstack(parts, format="csr")) for parts in factors)
    return Occlusion(np.concatenate(blocked).astype(np.float32), *stacked)


def points_at_once(directions: int) -> int:
    """How many points' rays are cast together."""
    return max(1, RAYS_AT_ONCE // directions)


def cosine_spiral(count: int) -> np.ndarray:
    """Directions about +z, (count, 3), each with the same share of ``∫ cos θ dω`` over the half sphere."""
    place = np.arange(count) + 0.5
    radius, angle = np.sqrt(place / count), 2 * np.pi * GOLDEN * place
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], axis=1)


def around(normals: np.ndarray, spiral: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """The spiral about every normal, turned by the vertex's number: (V · count, 3), float32."""
    first, second = tangents(normals)
    turn = 2 * np.pi * np.mod(PLASTIC * numbers, 1.0)[:, None]
    cosine, sine = np.cos(turn), np.sin(turn)
    x, y = first * cosine + second * sine, second * cosine - first * sine
    frames = np.stack([x, y, np.asarray(normals, np.float64)], axis=1)
    return (spiral @ frames).reshape(-1, 3).astype(np.float32)


def tangents(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors, (V, 3), that make a right-handed frame with each normal (Duff et al. 2017)."""
    x, y, z = np.asarray(normals, np.float64).T
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1)
    return first, np.stack([b, sign + y * y * a, -y], axis=1)


def _sums(values: np.ndarray, receiver: np.ndarray, count: int) -> np.ndarray:
    """Rows added up by receiver, (count, K)."""
    columns = [np.bincount(receiver, values[:, k], count) for k in range(values.shape[1])]
    return np.stack(columns, axis=1)


def _shares(
    receiver: np.ndarray, vertex: np.ndarray, shape: tuple[int, int], directions: int
) -> sp.csr_array:
    share = np.full(receiver.size, 1 / directions, np.float32)
    return sp.csr_array(sp.coo_array((share, (receiver, vertex)), shape=shape))
