"""What shines on a synthetic scene: a sky dome, extended lamps, an environment map."""

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
        Linear RGB, equirectangular; the top row is straight up, the middle column looks along −y of the
        world, and to the right of it lies −x, as one would see it standing inside.
    turn_deg : float
        By how much it is turned about the world's z axis, counter-clockwise seen from above.
    """

    radiance: np.ndarray
    turn_deg: float = 0.0


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


SKY_DOME = Light(Dome(sky=(1.0, 1.0, 1.0), ground=(0.2, 0.2, 0.2)))

# Azimuth (0 faces the figure, positive towards its left), elevation, shading when met head on.
FOUR_LAMPS = ((-50.0, 35.0, 0.8), (40.0, 20.0, 0.5), (130.0, 45.0, 0.6), (-140.0, 15.0, 0.4))
ONE_LAMP = ((-15.0, 35.0, 1.2),)


def lamps_around(
    places: tuple[tuple[float, float, float], ...], target: np.ndarray, radius: float
) -> tuple[Lamp, ...]:
    """Extended white lamps around a subject, four radii away and two radii wide.

    Parameters
    ----------
    places : tuple of (azimuth_deg, elevation_deg, shading)
        `shading` is what a small white card at `target` that faces the lamp would show.
    target : ndarray, shape (3,)
        Centre of the subject.
    radius : float
        Of the subject's bounding sphere, model units.
    """
    distance, side = 4 * radius, 2 * radius
    head_on = _shading_of_square(side / distance)
    lamps = []
    for azimuth, elevation, shading in places:
        a, e = np.deg2rad([azimuth, elevation])
        centre = target + distance * np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
        lamps.append(Lamp(tuple(centre), tuple(target), side, (shading / head_on,) * 3))
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
    elevation = np.pi / 2 - (np.arange(rows) + 0.5) / rows * np.pi
    radiance = dome_radiance(dome, elevation).astype(np.float32)
    return Environment(np.ascontiguousarray(np.broadcast_to(radiance[:, None], (rows, 2 * rows, 3))))
