"""Known light: a measured environment map whose yaw (rotation about the vertical) may be unknown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.light_from_pairs import PairLoss
from stages.photometry.light_search.search import Search
from stages.photometry.lighting.settings import KnownLightSettings
from stages.photometry.transport.environment import turned_light
from stages.photometry.transport.settings import EnvironmentMapSettings

NO_LIGHT = 1e-12  # mean shading of a channel: one without light in the picture stays dark


@dataclass(frozen=True, eq=False)
class KnownLight:
    """Environment map at infinity, with its orientation and scale as far as they are known.

    Attributes
    ----------
    picture : ndarray, shape (h, 2 h, 3)
        Radiance; z up, as `directions_of_picture` has it.
    upright_from_world : ndarray, shape (3, 3)
        Rotation to the frame whose z is up.
    turn_deg : float or None
        Yaw: rotation about the vertical, counter-clockwise seen from above; None: to be estimated.
    scale : float or None
        Factor from its values to the unit of the scaled images. None: unknown; each channel then has a
        factor of its own, and its mean is 1 here.
    how : EnvironmentMapSettings
    """

    picture: np.ndarray
    upright_from_world: np.ndarray
    turn_deg: float | None
    scale: float | None
    how: EnvironmentMapSettings

    @classmethod
    def of(
        cls,
        picture: np.ndarray,
        upright_from_world: np.ndarray,
        turn_deg: float | None,
        scale: float | None,
        how: EnvironmentMapSettings,
    ) -> KnownLight:
        """Normalise the picture, given in its own unit, if the scale is unknown; arguments as above."""
        if scale is None:
            mean = picture.mean(axis=(0, 1), dtype=np.float64)
            picture = picture / np.where(mean > 0, mean, 1.0).astype(np.float32)
        return cls(picture, upright_from_world, turn_deg, scale, how)

    def radiance(self, directions: np.ndarray, turn_deg: float) -> np.ndarray:
        """Sample the radiance from world directions, (M, 3), at a yaw."""
        light = turned_light(self.picture, turn_deg, self.upright_from_world, directions, self.how)
        return light if self.scale is None else self.scale * light

    def reduced(self, rows: int) -> KnownLight:
        """Downsample the picture to at most so many rows."""
        if self.picture.shape[0] <= rows:
            return self
        picture = cv2.resize(self.picture, (2 * rows, rows), interpolation=cv2.INTER_AREA)
        return replace(self, picture=picture)

    def turns(self, how: KnownLightSettings) -> int:
        """Count the steps of `turn_of`."""
        return 0 if self.turn_deg is not None else len(range(0, 360, how.turn_step_deg)) + how.finalists


def light_at(search: Search, known: KnownLight, turn_deg: float) -> LightEstimate:
    """Compute the light at a yaw, with its interreflection.

    Where its unit is unknown, every channel is scaled to a mean shading of 1 without bounces; then all
    channels are scaled together so that the brightest material has the prescribed reflectance.
    """
    light = known.radiance(search.part.pixels.directions, turn_deg)[None]
    dark = LightEstimate(light, search.even_light().bounced)
    if known.scale is None:
        mean = dark.direct(search.part, search.starts, search.light_of_view).mean(axis=0, dtype=np.float64)
        dark = replace(dark, radiance=light / np.where(mean > NO_LIGHT, mean, 1.0))
    return search.settled(dark.radiance, dark)


def turn_of(search: Search, known: KnownLight, how: KnownLightSettings, step: Callable[[], None]) -> float:
    """Estimate the yaw, degrees from 0 to 360, that minimises the loss of pairs; a given yaw is returned.

    Notes
    -----
    The loss is that of `light_from_pairs` at its finest scale. By default, yaws every 5° are compared without
    bounces; the three lowest local minima with their own bounces; then yaws every degree around the best of
    these. Each comparison uses the same pairs for all candidates.
    """
    if known.turn_deg is not None:
        return known.turn_deg
    known, directions = known.reduced(how.picture_rows), search.part.pixels.directions
    finest, turns = search.settings.finest_scale, np.arange(0, 360, how.turn_step_deg)
    losses, left = [search.loss(search.pairs(None, finest), finest)], []
    for turn in turns:
        left.append(_mean_loss(search, known.radiance(directions, float(turn)), None, losses))
        step()
    finalists, lights = turns[_lowest(np.array(left), how.finalists)], []
    for turn in finalists:
        lights.append(light_at(search, known, turn))
        step()
    losses = [search.loss(search.pairs(light, finest), finest) for light in lights]
    bounces = [search.bounce(light) for light in lights]
    left = [
        _mean_loss(search, light.radiance[0], indirect, losses)
        for light, indirect in zip(lights, bounces, strict=True)
    ]
    best = int(np.argmin(left))
    middle, light, indirect = finalists[best], lights[best].radiance[0], bounces[best]
    factor = light.sum(axis=0) / np.maximum(known.radiance(directions, middle).sum(axis=0), NO_LIGHT)
    near = middle + np.arange(1 - how.turn_step_deg, how.turn_step_deg, how.fine_turn_step_deg)
    left = [_mean_loss(search, factor * known.radiance(directions, turn), indirect, losses) for turn in near]
    return float(near[np.argmin(left)] % 360)


def _mean_loss(
    search: Search, light: np.ndarray, indirect: np.ndarray | None, losses: list[PairLoss]
) -> float:
    """Compute the loss of pairs under light (M, 3), averaged over several draws of them."""
    shading = search.sample.shares @ light.astype(np.float32)
    if indirect is not None:
        shading = shading + indirect
    return float(np.mean([loss.mean(shading) for loss in losses]))


def _lowest(left: np.ndarray, count: int) -> np.ndarray:
    """Find the `count` lowest local minima of values around a circle: indices, by ascending value."""
    lowest = np.flatnonzero((left <= np.roll(left, 1)) & (left <= np.roll(left, -1)))
    return lowest[np.argsort(left[lowest], kind="stable")][:count]
