"""What shines on a synthetic scene: a sky dome, a sky with its sun, extended lamps, an environment map."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Dome:
    """Light from infinitely far: radiance (linear RGB) from above and below, blended around the horizon."""

    sky: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ground: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Environment:
    """Light from infinitely far as a picture of all directions.

    Attributes
    ----------
    radiance : ndarray, shape (h, 2h, 3), float32
        Linear RGB, equirectangular; the top row is straight up and the bottom row straight down, the middle
        column looks along −y of the world, and to the right of it lies −x, as one would see it standing
        inside.
    turn_deg : float
        By how much it is turned about the world's z axis, counter-clockwise seen from above.
    """

    radiance: np.ndarray
    turn_deg: float = 0.0


@dataclass(frozen=True)
class ClearSky:
    """A blue sky with a warm sun, above sunlit ground; a card facing the sun shows about 1.

    Attributes
    ----------
    sun_azimuth_deg, sun_elevation_deg : float
        Azimuth 0 is where the figure looks, positive towards its left.
    sun_radius_deg : float
        Of the disc; the real one has 0.27. Larger ones soften the borders of shadows.
    sun : tuple of float
        Irradiance / π on a card that faces the sun alone.
    zenith, horizon, ground : tuple of float
        Radiance straight up, just above and all below the horizon.
    glow : float
        How much brighter than the sky around is the sky beside the sun.
    """

    sun_azimuth_deg: float = -40.0
    sun_elevation_deg: float = 40.0
    sun_radius_deg: float = 0.8
    sun: tuple[float, float, float] = (0.80, 0.70, 0.55)
    zenith: tuple[float, float, float] = (0.10, 0.19, 0.38)
    horizon: tuple[float, float, float] = (0.30, 0.36, 0.42)
    ground: tuple[float, float, float] = (0.16, 0.14, 0.11)
    glow: float = 3.0


@dataclass(frozen=True)
class Lamp:
    """A one-sided square emitter facing the point `towards`; `radiance` linear RGB, `side` in model units."""

    centre: tuple[float, float, float]
    towards: tuple[float, float, float]
    side: float
    radiance: tuple[float, float, float]


@dataclass(frozen=True)
class Light:
    """All that shines on a scene."""

    dome: Dome | Environment | None = field(default_factory=Dome)
    lamps: tuple[Lamp, ...] = ()


LAMP_DISTANCE = 4.0  # subject radii
SKY_DOME = Light(Dome(sky=(1.0, 1.0, 1.0), ground=(0.2, 0.2, 0.2)))


@dataclass(frozen=True)
class Placed:
    """Where an extended lamp stands around a subject.

    Attributes
    ----------
    azimuth_deg, elevation_deg : float
        Azimuth 0 is where the figure looks, positive towards its left.
    side_radii : float
        Its side; it stands four radii of the subject away.
    shading : float
        What a small white card in the subject's place, facing the lamp, would show.
    """

    azimuth_deg: float
    elevation_deg: float
    side_radii: float
    shading: float


FOUR_LAMPS = (
    Placed(-50, 35, 2, 0.8),
    Placed(40, 20, 2, 0.5),
    Placed(130, 45, 2, 0.6),
    Placed(-140, 15, 2, 0.4),
)
ONE_LAMP = (Placed(-15, 35, 4, 1.2),)


def lamps_around(places: tuple[Placed, ...], target: np.ndarray, radius: float) -> tuple[Lamp, ...]:
    """White lamps around a subject.

    Parameters
    ----------
    places : tuple of Placed
    target : ndarray, shape (3,)
        Centre of the subject.
    radius : float
        Of the subject's bounding sphere, model units.
    """
    lamps = []
    for place in places:
        towards_lamp = direction_at(place.azimuth_deg, place.elevation_deg)
        centre = target + LAMP_DISTANCE * radius * towards_lamp
        radiance = place.shading / _shading_of_square(place.side_radii / LAMP_DISTANCE)
        lamps.append(Lamp(tuple(centre), tuple(target), place.side_radii * radius, (radiance,) * 3))
    return tuple(lamps)


def _shading_of_square(ratio: float) -> float:
    """Irradiance / π on a card that faces a square of radiance 1, whose side is `ratio` distances.

    ``(4/π) · t/√(1+t²) · atan(t/√(1+t²))`` with t half the ratio: the form factor of a parallel square.
    """
    t = ratio / 2
    s = t / np.sqrt(1 + t * t)
    return 4 / np.pi * s * np.arctan(s)


def dome_radiance(dome: Dome, elevation: np.ndarray) -> np.ndarray:
    """Radiance from elevation(s) in radians, (..., 3): the ground's below −20°, the sky's above +20°."""
    t = np.clip(np.asarray(elevation)[..., None] / np.deg2rad(40) + 0.5, 0, 1)
    blend = t * t * (3 - 2 * t)
    return (1 - blend) * np.array(dome.ground) + blend * np.array(dome.sky)


def dome_picture(dome: Dome, rows: int = 128) -> Environment:
    """A dome as an environment map."""
    elevation = np.linspace(np.pi / 2, -np.pi / 2, rows)
    radiance = dome_radiance(dome, elevation).astype(np.float32)
    return Environment(np.ascontiguousarray(np.broadcast_to(radiance[:, None], (rows, 2 * rows, 3))))


def direction_at(azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    """Compute the unit vector, (3,), at an azimuth, 0 along −y and positive towards +x, and an elevation."""
    a, e = np.deg2rad([azimuth_deg, elevation_deg])
    return np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])


def angle_to_sun_deg(sky: ClearSky, directions: np.ndarray) -> np.ndarray:
    """Measure the angles between unit directions, (..., 3), and the sun: (...)."""
    towards = direction_at(sky.sun_azimuth_deg, sky.sun_elevation_deg)
    return np.rad2deg(np.arccos(np.clip(directions @ towards, -1, 1)))


def radiance_beside_sun(sky: ClearSky, directions: np.ndarray) -> np.ndarray:
    """Evaluate a clear sky without the sun's disc, and the ground below, in unit directions: (..., 3)."""
    up = directions[..., 2:]
    height = np.sqrt(np.clip(up, 0, 1))
    radiance = (1 - height) * np.array(sky.horizon) + height * np.array(sky.zenith)
    radiance = radiance * (1 + sky.glow * np.exp(-angle_to_sun_deg(sky, directions) / 12))[..., None]
    return np.where(up > 0, radiance, np.array(sky.ground))


def clear_sky_picture(sky: ClearSky, rows: int = 512) -> Environment:
    """Make an environment map of a clear sky.

    The sky's radiance runs from `horizon` to `zenith` with the sine of the elevation, ``1 − √sin e``, and
    grows beside the sun with ``1 + glow · exp(−γ / 12°)``, γ the angle to it. The disc's edge is two rows
    soft. Its radiance is set so that the map's own sum over the disc gives the irradiance `sun`.
    """
    elevation = np.linspace(np.pi / 2, -np.pi / 2, rows)[:, None]
    azimuth = (np.arange(2 * rows) + 0.5 - rows) * (-np.pi / rows)  # the middle looks along −y, right is −x
    level = np.cos(elevation)
    directions = np.stack(
        [level * np.sin(azimuth), -level * np.cos(azimuth), np.sin(elevation) + 0 * azimuth], axis=-1
    )
    radiance, from_sun_deg = radiance_beside_sun(sky, directions), angle_to_sun_deg(sky, directions)
    disc = np.clip((sky.sun_radius_deg - from_sun_deg) / (360 / rows) + 0.5, 0, 1)
    solid_angle = level * (np.pi / rows) ** 2
    radiance += disc[..., None] * np.array(sky.sun) * np.pi / (disc * solid_angle).sum()
    return Environment(radiance.astype(np.float32))
