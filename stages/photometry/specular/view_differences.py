"""Differences between corresponding pixels, and their explanation by mirrored light."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stages.photometry.specular.ggx_lobes import lobes
from stages.photometry.specular.settings import ViewDifferenceSettings
from stages.photometry.stack import Pixels, StackedViews
from stages.photometry.transport.directional_transport import DirectionalTransport
from stages.photometry.transport.light_priors import contrast
from stages.solvers.least_squares.non_negative import descend_above_zero


@dataclass(frozen=True, eq=False)
class MirroredLight:
    """Light that explains the view differences best in a mirror of one roughness.

    Attributes
    ----------
    radiance : ndarray, shape (M, 3)
        At least 0, times the mirror's strength. Its component common to all views is not determined.
    roughness : float
        α.
    left : float
        Share of the differences that remains: 1 where it explains nothing.
    explains_most : bool
        Whether all surface is taken to be specular.
    """

    radiance: np.ndarray
    roughness: float
    left: float
    explains_most: bool


@dataclass(frozen=True, eq=False)
class MirrorStrength:
    """Strength of a mirror of one roughness that explains the view differences best under a known light.

    Attributes
    ----------
    strength : ndarray, shape (3,)
        k of each channel.
    roughness : float
        α.
    left : float
        Share of the differences that remains.
    """

    strength: np.ndarray
    roughness: float
    left: float


@dataclass(frozen=True, eq=False)
class InMirror:
    """View differences along correspondences, and their derivative by light in a mirror of one roughness.

    Attributes
    ----------
    roughness : float
        α.
    difference : ndarray, shape (L, 3), float32
        ``I_p − f I_q`` with ``f = S_p / S_q``, of the brightness.
    lobes : ndarray, shape (L, M), float32
        ``m_p − f m_q``, m of `ggx_lobes.lobes`: `difference` per unit of radiance from each direction.
    cells : ndarray, shape (M,)
        Solid angle of each direction as a share of the sphere.
    how : ViewDifferenceSettings
    """

    roughness: float
    difference: np.ndarray
    lobes: np.ndarray
    cells: np.ndarray
    how: ViewDifferenceSettings

    def left(self, radiance: np.ndarray) -> tuple[float, np.ndarray]:
        """Compute the share of the differences that mirrored light (M, 3) leaves, and its gradient.

        ``Σ (√(d² + ε²) − ε)``, d the residual, ε the `noise`, over the same of the differences: 1 without
        light.
        """
        noise = self.how.noise
        off = self.difference - self.lobes @ radiance.astype(np.float32)
        root = np.sqrt(off**2 + noise**2, dtype=np.float32)
        left = float((root - noise).sum(dtype=np.float64))
        slope = -(self.lobes.T @ (off / root)) / self._total
        return left / self._total, slope.astype(np.float64)

    @cached_property
    def _total(self) -> float:
        noise = self.how.noise
        size = np.sqrt(self.difference**2 + noise**2, dtype=np.float32) - noise
        return max(float(size.sum(dtype=np.float64)), 1e-12)

    def light(self) -> MirroredLight:
        """Estimate the light that leaves least of the differences.

        The objective is convex but for a weak prior of uniform light, which determines directions that the
        differences do not.
        """

        def objective(radiance: np.ndarray) -> tuple[float, np.ndarray]:
            left, slope = self.left(radiance)
            price, own = contrast(radiance[None], self.cells)
            return left + self.how.evenness * price, slope + self.how.evenness * own[0]

        start = np.full((self.lobes.shape[1], 3), 0.1 * float(np.abs(self.difference).mean()))
        how = self.how
        radiance = descend_above_zero(objective, start, how.max_iterations, how.slope_tolerance)
        left = self.left(radiance)[0]
        return MirroredLight(radiance, self.roughness, left, left < how.explained_residual)

    def strength(self, radiance: np.ndarray) -> MirrorStrength:
        """Estimate the strength k ≥ 0 that minimises ``Σ |difference − k H|``, H of known light (M, 3).

        Solved by iteratively reweighted least squares.
        """
        mirrored = self.lobes @ radiance.astype(np.float32)
        weight = np.ones_like(self.difference)
        for _ in range(self.how.reweighting_rounds):
            squares = np.maximum((weight * mirrored**2).sum(axis=0), 1e-12)
            strength = np.maximum((weight * self.difference * mirrored).sum(axis=0) / squares, 0)
            weight = 1 / np.maximum(np.abs(self.difference - strength * mirrored), self.how.noise / 2)
        before, after = np.abs(self.difference).sum(), np.abs(self.difference - strength * mirrored).sum()
        return MirrorStrength(strength, self.roughness, float(after / before) if before > 0 else 1.0)


@dataclass(frozen=True, eq=False)
class Differences:
    """View differences along correspondences, for mirrors of several roughnesses.

    Attributes
    ----------
    p, q : ndarray, shape (L,)
        Pixels.
    mirrors : tuple of InMirror
        Of `ViewDifferenceSettings.roughnesses`.
    how : ViewDifferenceSettings
    """

    p: np.ndarray
    q: np.ndarray
    mirrors: tuple[InMirror, ...]
    how: ViewDifferenceSettings

    @classmethod
    def of(
        cls,
        views: StackedViews,
        image: np.ndarray,
        trusted: np.ndarray,
        towards: np.ndarray,
        pixels: DirectionalTransport,
        shading_at: Callable[[np.ndarray], np.ndarray],
        how: ViewDifferenceSettings,
    ) -> Differences:
        """Compute differences along a sample of correspondences that are trusted, and lit in every channel.

        Parameters
        ----------
        views : StackedViews
        image : ndarray, shape (N, 3), float32
            Gains of the views divided out, all views in one light.
        trusted : ndarray, shape (N,), bool
        towards : ndarray, shape (N, 3), float32
            Unit vectors to the cameras.
        pixels : DirectionalTransport
        shading_at : callable
            Shading of chosen pixels by the current estimate of that light: corresponding pixels show one
            point, so that their shading ratio depends little on it.
        how : ViewDifferenceSettings
        """
        p, q = sampled_correspondences(views, trusted, how.correspondences)
        of_p, of_q = shading_at(p), shading_at(q)
        least = how.min_shading * (of_p.mean(axis=0) + of_q.mean(axis=0)) / 2 if p.size else 0.0
        f = of_p.mean(axis=1) / np.maximum(of_q.mean(axis=1), 1e-12)
        most = how.max_shading_ratio
        lit = (np.minimum(of_p, of_q) > least).all(axis=1) & (f < most) & (f > 1 / most)
        p, q, f = p[lit], q[lit], f[lit, None].astype(np.float32)
        apart = image[p] - f * image[q]
        own_lobes = (lobes(pixels, towards, a, p) - f * lobes(pixels, towards, a, q) for a in how.roughnesses)
        mirrors = (
            InMirror(a, apart, own, pixels.cells, how)
            for a, own in zip(how.roughnesses, own_lobes, strict=True)
        )
        return cls(p, q, tuple(mirrors), how)

    def within(self, glossy: np.ndarray) -> Differences:
        """Select the correspondences with both pixels in a set, (N,) bool."""
        both = glossy[self.p] & glossy[self.q]
        mirrors = (
            replace(each, difference=each.difference[both], lobes=each.lobes[both]) for each in self.mirrors
        )
        return Differences(self.p[both], self.q[both], tuple(mirrors), self.how)

    @cached_property
    def mirrored(self) -> MirroredLight | None:
        """Light, with its roughness, that leaves least of the differences.

        None where there are too few correspondences, or views do not differ.
        """
        how, middle = self.how, self.mirrors[self.how.middle_roughness]
        enough = how.min_correspondences_per_direction * min(middle.lobes.shape[1], how.resolved_directions)
        if self.p.size < enough or np.abs(middle.difference).mean() < how.min_difference * how.noise:
            return None
        found = middle.light()
        if found.left >= how.hopeless_residual:
            return found
        others = (mirror.light() for mirror in self.mirrors if mirror is not middle)
        return min((found, *others), key=lambda light: light.left)

    def strength(self, radiance: np.ndarray) -> MirrorStrength | None:
        """Estimate strength and roughness under a known light (M, 3); None with too few correspondences.

        Three parameters instead of the hundreds of `mirrored`, for clusters with few correspondences.
        """
        if self.p.size < self.how.min_correspondences:
            return None
        found = (mirror.strength(radiance) for mirror in self.mirrors)
        return min(found, key=lambda fit: fit.left)

    def in_mirror(self, roughness: float) -> InMirror:
        """Select the mirror of one of the roughnesses."""
        return next(mirror for mirror in self.mirrors if mirror.roughness == roughness)


def sampled_correspondences(views: StackedViews, trusted: np.ndarray, count: int) -> Pixels:
    """Sample correspondences at a constant stride, `count` to twice as many; keep the trusted ones, (N,)."""
    stride, passed = max(1, views.correspondence_count // count), 0
    ends: list[Pixels] = [(np.empty(0, np.int64), np.empty(0, np.int64))]
    for p, q in views.linked_pixels():
        ends.append((p[-passed % stride :: stride], q[-passed % stride :: stride]))
        passed += p.size
    one, other = (np.concatenate(side) for side in zip(*ends, strict=True))
    both = trusted[one] & trusted[other]
    return one[both], other[both]
