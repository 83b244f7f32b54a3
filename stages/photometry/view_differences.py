"""How views differ about what they both see, and what light would make them differ so, were it a mirror."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from stages.photometry.light_from_pairs import contrast
from stages.photometry.sky import SkyTransport
from stages.photometry.stack import Pixels, StackedViews

ROUGHNESSES = (0.15, 0.2, 0.3)  # α of GGX: a sharper lobe falls between 256 directions
LINKS = 15_000  # that are looked at, or up to twice as many
FEWEST = 200  # of them: what fewer differ by is as well explained by chance
LIT = 0.1  # of the mean shading, per channel: what a link's ends have at least
ALIKE = 5.0  # times: what one end is lit by more than the other where they show the same surface
NOISE = 0.02  # of the scaled image: differences below this count by their square
EVENNESS = 1e-3  # price of light that differs from direction to direction, where views do not tell
STEPS = 60  # of the descent
BELIEVED = 0.9  # of the views' differences; mirrors that leave more are none
ROUNDS = 10  # of reweighting
PAINT_BELIEVED = 0.98  # as `BELIEVED`, of one paint, for one number instead of one for each direction
STRONGEST = 1.0  # of a mirror: more is no sheen on paint, but views too near one another to tell


@dataclass(frozen=True, eq=False)
class MirroredLight:
    """Light that, in a mirror of one roughness, makes views differ as they do.

    Attributes
    ----------
    radiance : ndarray, shape (M, 3)
        At least 0, times the mirror's strength. What all views see alike of it is not told.
    roughness : float
        α.
    left : float
        What it leaves of the differences: 1 where there is nothing of a mirror.
    """

    radiance: np.ndarray
    roughness: float
    left: float


@dataclass(frozen=True, eq=False)
class Differences:
    """How views differ along links, and how mirrors would make them differ.

    Attributes
    ----------
    p, q : ndarray, shape (L,)
        Pixels.
    seen : ndarray, shape (L, 3), float32
        ``I_p − f I_q`` with ``f = S_p / S_q``, of the brightness.
    lobes : tuple of ndarray, shape (L, M), float32
        ``m_p − f m_q`` of every roughness, m as `SkyTransport.lobes` has it: what light of each direction
        would add to `seen` in a mirror.
    """

    p: np.ndarray
    q: np.ndarray
    seen: np.ndarray
    lobes: tuple[np.ndarray, ...]

    @classmethod
    def of(
        cls,
        views: StackedViews,
        seen: np.ndarray,
        trusted: np.ndarray,
        towards: np.ndarray,
        pixels: SkyTransport,
        shading_at: Callable[[np.ndarray], np.ndarray],
    ) -> Differences:
        """Along some of the links between pixels that are trusted, and lit in every channel.

        Parameters
        ----------
        views : StackedViews
        seen : ndarray, shape (N, 3), float32
            The image, gains of the views divided out, all views in one light.
        trusted : ndarray, shape (N,), bool
        towards : ndarray, shape (N, 3), float32
            Unit vectors to the cameras.
        pixels : SkyTransport
        shading_at : callable
            Of chosen pixels by that light, as far as it is known.
        """
        p, q = _some_links(views, trusted)
        of_p, of_q = shading_at(p), shading_at(q)
        least = LIT * (of_p.mean(axis=0) + of_q.mean(axis=0)) / 2 if p.size else 0.0
        f = of_p.mean(axis=1) / np.maximum(of_q.mean(axis=1), 1e-12)
        lit = (np.minimum(of_p, of_q) > least).all(axis=1) & (f < ALIKE) & (f > 1 / ALIKE)
        p, q, f = p[lit], q[lit], f[lit, None].astype(np.float32)
        ends = ((pixels.lobes(towards, each, p), pixels.lobes(towards, each, q)) for each in ROUGHNESSES)
        return cls(p, q, seen[p] - f * seen[q], tuple(one - f * other for one, other in ends))

    def within(self, glossy: np.ndarray) -> Differences:
        """Those with both ends among some of the pixels, (N,) bool."""
        both = glossy[self.p] & glossy[self.q]
        return Differences(self.p[both], self.q[both], self.seen[both], tuple(m[both] for m in self.lobes))

    @cached_property
    def mirrored(self) -> MirroredLight | None:
        """The light that explains most of them, in the mirror for which it does; None if there is no such.

        Notes
        -----
        Minimises ``Σ |I_p − f I_q − Σ_d (m_p − f m_q)_d s_d|`` over s ≥ 0, for each of some roughnesses:
        convex, and needs to know neither the light nor the paint. Matt surface is not explained by any: the
        mirror in the middle tells.
        """
        if self.p.size < FEWEST:
            return None
        middle = self._mirrored_in(len(ROUGHNESSES) // 2)
        if middle.left >= BELIEVED:
            return None
        rougher_or_less = (self._mirrored_in(number) for number in (0, 2))
        return min((middle, *rougher_or_less), key=lambda light: light.left)

    def _mirrored_in(self, number: int) -> MirroredLight:
        lobes = self.lobes[number]
        shape = (lobes.shape[1], 3)

        def objective(values: np.ndarray) -> tuple[float, np.ndarray]:
            radiance = values.reshape(shape)
            left, slope = self.left(number, radiance)
            price, own = contrast(radiance[None])
            return left + EVENNESS * price, (slope + EVENNESS * own[0]).ravel()

        start = np.full(shape[0] * 3, 0.1 * float(np.abs(self.seen).mean()))
        bounds = [(0.0, None)] * start.size
        found = minimize(
            objective, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": STEPS}
        )
        radiance = found.x.reshape(shape)
        return MirroredLight(radiance, ROUGHNESSES[number], self.left(number, radiance)[0])

    def left(self, number: int, radiance: np.ndarray) -> tuple[float, np.ndarray]:
        """What light (M, 3) leaves in the mirror of that number, 0 to 1 and beyond, and the slope by it."""
        off = self.seen - self.lobes[number] @ radiance.astype(np.float32)
        root = np.sqrt(off**2 + NOISE**2, dtype=np.float32)
        left = float((root - NOISE).sum(dtype=np.float64))
        slope = -(self.lobes[number].T @ (off / root)) / self._all
        return left / self._all, slope.astype(np.float64)

    @cached_property
    def _all(self) -> float:
        size = np.sqrt(self.seen**2 + NOISE**2, dtype=np.float32) - NOISE
        return max(float(size.sum(dtype=np.float64)), 1e-12)

    def shows(self, radiance: np.ndarray) -> bool:
        """Whether a mirror of known light (M, 3) explains enough of them, of one strength for each channel.

        Two or three numbers instead of the hundreds of `mirrored`: for paints with few links.
        """
        if self.p.size < FEWEST:
            return False
        light = radiance.astype(np.float32)
        return any(_fits(self.seen, lobes @ light) for lobes in self.lobes)


def _fits(apart: np.ndarray, mirrored: np.ndarray) -> bool:
    """Whether ``|apart − k mirrored|``, k ≥ 0 by reweighted least squares, is enough below ``|apart|``."""
    weight = np.ones_like(apart)
    for _ in range(ROUNDS):
        squares = np.maximum((weight * mirrored**2).sum(axis=0), 1e-12)
        strength = np.maximum((weight * apart * mirrored).sum(axis=0) / squares, 0)
        weight = 1 / np.maximum(np.abs(apart - strength * mirrored), NOISE / 2)
    before, after = np.abs(apart).sum(), np.abs(apart - strength * mirrored).sum()
    return bool(after < PAINT_BELIEVED * before and strength.max() < STRONGEST)


def _some_links(views: StackedViews, trusted: np.ndarray) -> Pixels:
    """Every so many-th link, if both its ends are trusted."""
    stride = max(1, views.link_count // LINKS)
    nobody = np.empty(0, np.int64)
    ends = [(nobody, nobody), *((one[::stride], other[::stride]) for one, other in views.linked_pixels())]
    one, other = (np.concatenate(side) for side in zip(*ends, strict=True))
    both = trusted[one] & trusted[other]
    return one[both], other[both]
