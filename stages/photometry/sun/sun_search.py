"""Search for suns and lamps: small sources in place of groups of bright directions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

import numpy as np

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.light_from_pairs import PairLoss
from stages.photometry.light_search.search import Search
from stages.photometry.sun.pixel_rays import WHOLE, PixelRays
from stages.photometry.sun.settings import SunSettings
from stages.photometry.transport.directional_transport import arriving, axes_across
from stages.photometry.transport.lit_scenes import LitScene


class Photos(Protocol):
    """What the light is estimated from."""

    def search(self, scene: LitScene) -> Search:
        """Draw the pairs of equal albedo."""

    def light(
        self, scene: LitScene, step: Callable[[], None], near: LightEstimate | None = None
    ) -> LightEstimate:
        """Estimate the light, starting from one near it."""

    def disagreements(self, scenes: Sequence[LitScene], lights: Sequence[LightEstimate]) -> list[float]:
        """Compute the loss of the same pairs under each of several lights."""


def with_suns(
    scene: LitScene, found: LightEstimate, photos: Photos, rays: PixelRays, step: Callable[[], None]
) -> tuple[LitScene, LightEstimate]:
    """Replace groups of bright directions by suns where these explain the photos better.

    Parameters
    ----------
    scene : LitScene
        Without suns.
    found : LightEstimate
        One light for all pixels.
    photos : Photos
    rays : PixelRays
        Of the scene's pixels.
    step : callable
        Called after every scale of the search.

    Returns
    -------
    tuple of LitScene and LightEstimate
        The last directions are the suns. As given where none was found.

    Notes
    -----
    The sun measures half a degree, a cell of directions five, and shadows that are interpolated between
    vertices are blurred: the light that explains the photos best then covers several cells, and its middle is
    degrees off. Instead of a group of bright cells one source is tried, in some hundred directions around
    their middle, with the shadow that the pixels themselves see, for that under which pairs of equal albedo
    disagree least; all light is then estimated anew. The sun is kept if pairs now disagree less than under
    the group by `sun.gain`, its direction found once more, nearby, and the next is looked for.
    """
    how = rays.how
    tried = np.zeros(len(found.radiance[0]), bool)
    for _ in range(how.most):
        bright = BrightGroup.of(found.radiance[0], scene, how, ~tried)
        if bright is None:
            break
        trial = _Trial.of(photos.search(scene), found, bright, rays)
        sun = trial.best((how.within_deg, *how.steps_deg), how.brightness)
        other, light = _with_sun(scene, found, bright, sun, rays, across=1)  # roughly: it may not stay
        light = photos.light(other, step, near=light)
        before, after = photos.disagreements([scene, other], [found, light])
        if after > (1 - how.gain) * before:
            break
        scene, found, tried = other, light, np.append(tried | bright.chosen, True)
        scene, found = _aimed(len(tried) - 1, scene, found, photos, rays)
        found = photos.light(scene, step, near=found)
    return scene, found


def aimed_anew(
    scene: LitScene, found: LightEstimate, photos: Photos, rays: PixelRays, hidden: np.ndarray
) -> tuple[LitScene, LightEstimate]:
    """Search the directions of the suns of a scene once more, nearby, given what hides them.

    Parameters
    ----------
    scene : LitScene
        Its suns are hidden by the mesh alone.
    found : LightEstimate
    photos : Photos
    rays : PixelRays
    hidden : ndarray, shape (N, k), bool
        Pixels from which something else hides a sun.
    """
    for number in range(hidden.shape[1]):  # each becomes the last one
        first = len(scene.pixels.directions) - hidden.shape[1]
        scene, found = _aimed(first, scene, found, photos, rays, hidden[:, number])
    return scene, found


def _aimed(
    number: int,
    scene: LitScene,
    found: LightEstimate,
    photos: Photos,
    rays: PixelRays,
    hidden: np.ndarray | None = None,
) -> tuple[LitScene, LightEstimate]:
    """Search the direction of one sun nearby; it becomes the last one. `hidden`, (N,): see `aimed_anew`."""
    alone = BrightGroup.alone(number, found.radiance[0], scene)
    sun = _Trial.of(photos.search(scene), found, alone, rays, hidden).best(rays.how.steps_deg, (1.0,))
    return _with_sun(scene, found, alone, sun, rays, kept=~alone.chosen)


@dataclass(frozen=True, eq=False)
class BrightGroup:
    """Bright directions that may be one sun.

    Attributes
    ----------
    chosen : ndarray, shape (M,), bool
    middle : ndarray, shape (3,)
        Unit.
    flux : ndarray, shape (3,)
        Radiance times solid angle, the latter as a share of the sphere.
    """

    chosen: np.ndarray
    middle: np.ndarray
    flux: np.ndarray

    @classmethod
    def of(
        cls, light: np.ndarray, scene: LitScene, how: SunSettings, among: np.ndarray
    ) -> BrightGroup | None:
        """Choose the directions around the greatest flux of a light, (M, 3), among some, (M,), bool.

        None where none is bright, or all of them together are weak.
        """
        directions, cells = scene.pixels.directions, scene.pixels.cells
        brightness = light.sum(axis=1)
        among = among & (brightness > how.bright * (brightness @ cells) / cells.sum())
        if not among.any():
            return None
        flux = np.where(among, brightness * cells, 0)
        near = directions @ directions.T > np.cos(np.deg2rad(how.within_deg))
        chosen = among & near[np.argmax(np.where(among, near @ flux, 0))]
        if flux[chosen].sum() < how.least_share * (brightness @ cells):
            return None
        middle = flux[chosen] @ directions[chosen]
        return cls(chosen, middle / np.linalg.norm(middle), (light * cells[:, None])[chosen].sum(axis=0))

    @classmethod
    def alone(cls, number: int, light: np.ndarray, scene: LitScene) -> BrightGroup:
        """Take one direction alone."""
        chosen = np.arange(len(light)) == number
        return cls(chosen, scene.pixels.directions[number], light[number] * scene.pixels.cells[number])


@dataclass(frozen=True, eq=False)
class Sun:
    """A small source: unit direction, (3,), flux as of `BrightGroup`, by how much less pairs disagree."""

    direction: np.ndarray
    flux: np.ndarray
    gain: float


@dataclass(frozen=True, eq=False)
class _Trial:
    """Pairs of pixels under all light but that of a group of directions."""

    search: Search
    rays: PixelRays
    loss: PairLoss
    group: BrightGroup
    rest: np.ndarray  # shading without the group, (n, 3)
    unhidden: np.ndarray  # where nothing but the mesh may hide it, (n,)
    before: float  # disagreement with it

    @classmethod
    def of(
        cls,
        search: Search,
        found: LightEstimate,
        group: BrightGroup,
        rays: PixelRays,
        hidden: np.ndarray | None = None,
    ) -> _Trial:
        light, sample = found.radiance[0].astype(np.float32), search.sample
        finest = search.settings.finest_scale
        loss = search.loss(search.pairs(found, finest), finest)
        rest = sample.shares @ np.where(group.chosen[:, None], 0, light) + search.bounce(found)
        every = np.ones(len(rest), bool)
        unhidden = (every if hidden is None else ~hidden[search.drawn.pixels]).astype(np.float32)
        own = unhidden[:, None] * (sample.shares[:, group.chosen] @ light[group.chosen])
        return cls(search, rays, loss, group, rest, unhidden, before=loss.mean(rest + own))

    def best(self, steps_deg: Sequence[float], brightness: Sequence[float]) -> Sun:
        """Search from coarse to fine for the direction of least disagreement, at first in brightness, too.

        `steps_deg`: the radius that is searched, and the distances of the directions.
        """
        best = Sun(self.group.middle, self.group.flux, -np.inf)
        for radius_deg, step_deg in pairwise(steps_deg):
            directions = directions_around(best.direction, radius_deg, step_deg)
            fluxes = [factor * best.flux for factor in brightness]
            for direction, seen in zip(directions, self._received(directions).T, strict=True):
                for flux in fluxes:
                    left = self.loss.mean(self.rest + seen[:, None] * flux)
                    best = max(best, Sun(direction, flux, 1 - left / self.before), key=lambda sun: sun.gain)
            brightness = (1.0,)
        return best

    def _received(self, directions: np.ndarray) -> np.ndarray:
        """Compute the shading of the pixels by unit flux from directions, (n, k), float32."""
        pixels = self.search.drawn.pixels
        where = self.search.part.pixels.at(self.search.among)
        seen = self.rays.see(directions, self.search.part.sphere, where.normals, pixels, 1)
        received = 4 * arriving(where.normals, where.offsets, directions) * (seen / np.float32(WHOLE))
        return received * self.unhidden[:, None]


def directions_around(middle: np.ndarray, radius_deg: float, step_deg: float) -> np.ndarray:
    """Distribute directions in a hexagonal grid up to a radius around one, (k, 3), float32."""
    rows = int(np.ceil(radius_deg / step_deg * 2 / np.sqrt(3)))
    row, column = (grid.ravel() for grid in np.mgrid[-rows : rows + 1, -rows - 1 : rows + 2])
    across, up = step_deg * (column + row % 2 / 2), step_deg * row * np.sqrt(3) / 2
    inside = np.hypot(across, up) <= radius_deg
    one, other = axes_across(middle[None])
    across, up = (np.deg2rad(part[inside])[:, None] for part in (across, up))
    found = middle + across * one + up * other
    return (found / np.linalg.norm(found, axis=1, keepdims=True)).astype(np.float32)


def _with_sun(
    scene: LitScene,
    found: LightEstimate,
    group: BrightGroup,
    sun: Sun,
    rays: PixelRays,
    kept: np.ndarray | None = None,
    across: int | None = None,
) -> tuple[LitScene, LightEstimate]:
    """Add a sun as the last direction, in place of the light of a group; directions that are kept, (M,).

    `across`: as of `PixelRays.see`.
    """
    pixels, probes = scene.pixels, scene.probes
    if probes is None:
        raise ValueError("visibility probes of the vertices, which see the sun, too")
    count, suns = len(pixels.directions), pixels.traced.shape[1]
    kept = np.ones(count, bool) if kept is None else kept
    towards, cell = sun.direction[None], np.float32(np.sin(np.deg2rad(rays.how.radius_deg) / 2) ** 2)
    by_vertices = np.unpackbits(pixels.visible, axis=1, count=count)[:, kept]
    seen = np.unpackbits(probes.see(towards, scene.sphere), axis=1, count=1)
    by_vertices = np.concatenate([by_vertices, seen], axis=1)
    traced = rays.see(towards, scene.sphere, pixels.normals, across=across)
    vertices = replace(
        scene.vertices,
        directions=np.concatenate([pixels.directions[kept], towards]),
        cells=np.append(pixels.cells[kept], cell),
        visible=np.packbits(by_vertices, axis=1),
    )
    pixels = replace(
        pixels,
        directions=vertices.directions,
        cells=vertices.cells,
        visible=vertices.visible,
        traced=np.concatenate([pixels.traced[:, kept[count - suns :]], traced], axis=1),
    )
    scene = replace(scene, pixels=pixels, vertices=vertices)
    light = np.where(group.chosen[:, None], 0, found.radiance[0])[kept]
    return scene, replace(found, radiance=np.concatenate([light, sun.flux[None] / cell])[None])
