"""Sun and sky on a street, by rays of our own: irradiance over π at vertices and at pixels.

The sky and its bounces are found at the vertices and interpolated; the sun's shadow is found at each pixel,
by four rays across its disc.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.geometry.occluders import Occluders
from stages.photometry.transport.directional_transport import even_directions
from stages.synthetic.lights import ClearSky, direction_at, radiance_beside_sun

SKY = ClearSky(sun_azimuth_deg=-35.0, sun_elevation_deg=42.0)
DIRECTIONS = 192  # of the sky, all around
BOUNCES = 6  # leave out .25 % of the skylight at most at 99.9 % of the vertices; two leave out 10 % at 1 %
LIFT = 0.002  # of a ray's origin along the normal, model units: a quarter of an edge
AT_ONCE = 200_000  # rays: 30 MB
FREE, DARK = -1, -2  # instead of the vertex that a ray meets: nothing; not its front
DISC = ((-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5))  # of the sun: rays, in radii


@dataclass(frozen=True, eq=False)
class Daylight:
    """Light on a street.

    Attributes
    ----------
    occluders : Occluders
        Of the street's mesh.
    skylight : ndarray, shape (V, 3), float32
        Irradiance over π at the vertices from the sky, the ground beyond, and by bounces; without the sun.
    """

    occluders: Occluders
    skylight: np.ndarray

    @classmethod
    def of(
        cls, occluders: Occluders, points: np.ndarray, normals: np.ndarray, albedo: np.ndarray
    ) -> Daylight:
        """Light the vertices: points (V, 3) relative to the occluders' origin, normals and albedo (V, 3)."""
        direct, lit = np.zeros((2, *points.shape), np.float32)
        own = cls(occluders, direct)
        lit += own.sunlight(points, normals)
        directions = even_directions(DIRECTIONS).astype(np.float32)
        radiance = radiance_beside_sun(SKY, directions).astype(np.float32)
        weight = 4 / DIRECTIONS  # solid angle over π
        met = []
        for direction, shines in zip(directions, radiance, strict=True):
            cosine = np.maximum(normals @ direction, 0)
            vertex = _first_met(occluders, points, normals, direction, cosine > 0)
            direct += weight * np.where(vertex == FREE, cosine, 0)[:, None] * shines
            met.append(vertex)
        shown = direct + lit
        for _ in range(BOUNCES):
            reflected, bounced = albedo * shown, np.zeros_like(direct)
            for direction, vertex in zip(directions, met, strict=True):
                cosine = np.where(vertex >= 0, np.maximum(normals @ direction, 0), 0)
                bounced += weight * cosine[:, None] * reflected[np.maximum(vertex, 0)]
            shown = direct + lit + bounced
        return cls(occluders, direct + bounced)

    def sunlight(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Compute the sun's irradiance over π, (n, 3), at points relative to the occluders' origin."""
        total = np.zeros(len(points), np.float32)
        for direction in sun_directions():
            cosine = np.maximum(normals @ direction, 0)
            vertex = _first_met(self.occluders, points, normals, direction, cosine > 0)
            total += np.where(vertex == FREE, cosine, 0) / len(DISC)
        return total[:, None] * np.array(SKY.sun, np.float32)


def _first_met(
    occluders: Occluders, points: np.ndarray, normals: np.ndarray, direction: np.ndarray, facing: np.ndarray
) -> np.ndarray:
    """Find the vertex that a ray from each point meets first, (n,), int32, or `FREE`, or `DARK`."""
    vertex = np.full(len(points), DARK, np.int32)
    for chosen in np.array_split(np.flatnonzero(facing), max(1, int(facing.sum()) // AT_ONCE)):
        origins = (points[chosen] + LIFT * normals[chosen]).astype(np.float32)
        found, behind = occluders.cast(origins, np.broadcast_to(direction, origins.shape))
        vertex[chosen] = np.where(behind, DARK, found)
    return vertex


def sun_directions() -> np.ndarray:
    """List directions to points of the sun's disc, (4, 3), float32."""
    towards = direction_at(SKY.sun_azimuth_deg, SKY.sun_elevation_deg)
    right = np.cross([0, 0, 1], towards)
    right /= np.linalg.norm(right)
    up, radius = np.cross(towards, right), np.deg2rad(SKY.sun_radius_deg)
    rays = np.array([towards + radius * (x * right + y * up) for x, y in DISC])
    return (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)
