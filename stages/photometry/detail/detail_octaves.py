"""Octaves of the residual of a smooth albedo, filtered by the uncertainty of shading and noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stages.photometry.detail.detail_scene import AXES, LIT, QUOTIENT, DetailScene
from stages.photometry.detail.scene_statistics import OctaveStatistics, SampledOctave, SampledViews
from stages.photometry.detail.shading_uncertainty import ShownChange, uncertain_energy
from stages.solvers.kernels.pixelwise import Chosen, pixelwise

TINY = 1e-12  # against division by 0, of squares


@dataclass(frozen=True, eq=False)
class LocalEnergies:
    """Energies around the pixels of an octave, and what they are compared with.

    Attributes
    ----------
    band : ndarray, shape (N, 3)
        Of the residual, fused with that of other views.
    of_view : ndarray, shape (N, 8)
        Local energy of the band and mean variance of its noise, in three axes each; mean square of the
        shading's change after the reduction, mean product of the band's first axis and the change; in each
        view alone.
    stated : ndarray, shape (N,)
        Local mean of the mean square of the change before the reduction.
    """

    band: np.ndarray
    of_view: np.ndarray
    stated: np.ndarray


@dataclass(frozen=True, eq=False)
class DetailOctave:
    """One octave of a scene, the shading's change reduced to that which the photos show.

    Attributes
    ----------
    scene : DetailScene
    left : ndarray, shape (N, 3)
        Band of the residual, in its axes.
    change : ndarray, shape (N,)
        Band of the log shading, times the response of ``log(I + d)``.
    size, stated : ndarray, shape (N,)
        Local mean square of the shading's band, after and before the reduction.
    shown : ShownChange or None
        How much of the shading's change the photos show; None in the coarse octaves.
    wide_px : float
        σ of the Gaussian that energies are averaged under.
    sample : SampledOctave
        Of the bands before the reduction; without differences and energies.
    """

    scene: DetailScene
    left: np.ndarray
    change: np.ndarray
    size: np.ndarray
    stated: np.ndarray
    shown: ShownChange | None
    wide_px: float
    sample: SampledOctave

    @classmethod
    def of(
        cls,
        scene: DetailScene,
        number: int,
        bands: np.ndarray,
        sigma_px: float,
        known: OctaveStatistics | None = None,
    ) -> DetailOctave:
        """Reduce the shading's change, in the fine octaves, to that which the photos show."""
        how, some = scene.how, scene.sample
        left, quotient, change = bands[:, AXES].copy(), bands[:, QUOTIENT], bands[:, LIT] * scene.response
        window_px = max(sigma_px, how.least_shading_window_px)
        stated = size = scene.pixels.mean_of(np.square, change, sigma_px=window_px)
        none = np.zeros((0, 3), np.float32)
        sample = SampledOctave(
            number,
            sigma_px,
            change[some],
            left[some],
            quotient[some],
            stated[some],
            difference=none,
            texture=none[:, 0],
            energy=none,
            wide_noise=none,
            wide_size=none[:, 0],
            wide_stated=none[:, 0],
            wide_product=none[:, 0],
            wide_excess=none[:, 0],
        )
        shown = sample.shown(how) if known is None else known.shown
        if shown is not None:
            lost, size = pixelwise(shown.reduction, change, stated)
            left[:, 0] -= lost
        wide_px = max(how.window * sigma_px, how.least_window_px)
        return cls(scene, left, change, size, stated, shown, wide_px, sample)

    def compared(self, coarser: np.ndarray) -> SampledOctave:
        """Sample the differences between views; `coarser`: the band of log I/S in the next octave."""
        scene, some = self.scene, self.scene.sample
        some = some[scene.others.count[some] > 0]
        of_both = scene.noise_scale[some] * np.sqrt(1 + 1 / scene.others.count[some])[:, None]
        difference = (self.left[some] - self.left_by_others[some]) / of_both
        # of brightness, which has the least noise
        texture = scene.pixels.mean_of(np.square, coarser, sigma_px=self.wide_px)
        return replace(self.sample, difference=difference, texture=texture[some])

    @cached_property
    def left_by_others(self) -> np.ndarray:
        """Mean of `left` in other views, (N, 3)."""
        return self.scene.others.mean(self.left)

    def local(self, noise: np.ndarray) -> LocalEnergies:
        """Average energies around every pixel, in each view.

        `noise`: standard deviation of this band's at median brightness, (3,).
        """
        how, power = self.scene.how, self.scene.how.energy_power

        def powers(
            band: np.ndarray, noise: np.ndarray, size: np.ndarray, change: np.ndarray, stated: np.ndarray
        ) -> np.ndarray:
            return np.column_stack([np.abs(band) ** power, noise, size, band[:, 0] * change, stated])

        def energies(means: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            energy = means[:, :3] ** (2 / power) / how.energy_of_normal
            return np.column_stack([energy, means[:, 3:8]]), means[:, 8].copy()

        band, variance = self._fused(noise.astype(np.float32))
        of_pixels = band, variance, self.size, self.change, self.stated
        means = self.scene.pixels.mean_of(powers, *of_pixels, sigma_px=self.wide_px)
        del variance, of_pixels  # frees memory
        return LocalEnergies(band, *pixelwise(energies, means))

    def measured(self, sample: SampledOctave, local: LocalEnergies) -> SampledOctave:
        """Add energies to a sample of this octave: means over a pixel and its correspondences."""
        some = self.scene.sample
        means, wide = self.scene.others.with_own(local.of_view, some), local.stated[some]
        return replace(
            sample,
            energy=means[:, :3],
            wide_noise=means[:, 3:6],
            wide_size=means[:, 6],
            wide_product=means[:, 7],
            wide_stated=wide,
            wide_excess=np.zeros_like(wide) if self.shown is None else self.shown.at(wide),
        )

    def filtered(
        self, local: LocalEnergies, by: OctaveStatistics, at: Chosen
    ) -> tuple[np.ndarray, np.ndarray]:
        """Filter the band at n pixels.

        Returns
        -------
        tuple of ndarray, shape (n, 3), and ndarray, shape (n,)
            The share of the band that is albedo, 0 where no data are trusted, and the expected variance of
            its first axis.
        """
        scene = self.scene

        def share(
            band: np.ndarray, means: np.ndarray, stated: np.ndarray, trusted: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            uncertain = uncertain_energy(by.of_change, means[:, 6], means[:, 3:6], scene.how)
            return by.limit.filtered(band, means[:, :3].copy(), uncertain, stated, trusted)

        means = scene.others.with_own(local.of_view, at)
        return pixelwise(share, local.band[at], means, local.stated[at], scene.trusted[at])

    def _fused(self, typical: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Fuse the band with that of other views; returns it and the variance of its noise, (N, 3) each.

        `typical`: standard deviation of the noise at median brightness, (3,), float32. Weights are inverse
        variances. That of the others is the noise over their number, plus misregistration: the excess of the
        differences between views over noise.
        """
        scene, others = self.scene, self.scene.others
        noise = pixelwise(lambda scale: np.square(typical * scale), scene.noise_scale)
        if not (others.count.any() and noise.any()):
            return self.left, noise
        difference = pixelwise(_difference_to_others, others.count, self.left_by_others, self.left)
        apart = scene.seen_by_others.mean_of(np.square, difference, sigma_px=self.wide_px)
        return pixelwise(_weighted_by_variance, others.count, self.left, difference, noise, apart)


def _difference_to_others(count: np.ndarray, others: np.ndarray, own: np.ndarray) -> np.ndarray:
    return np.where(count[:, None] > 0, others - own, 0)


def _weighted_by_variance(
    count: np.ndarray, own: np.ndarray, difference: np.ndarray, noise: np.ndarray, apart: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Average a band and that of other views, by inverse variance; returns it and its variance."""
    number = np.maximum(count, 1)[:, None]
    of_others = noise / number + np.maximum(apart - noise * (1 + 1 / number), 0)
    weight = np.where(count[:, None] > 0, noise / np.maximum(noise + of_others, TINY), 0)
    return own + weight * difference, (1 - weight) ** 2 * noise + weight**2 * of_others


def octaves_of_views(scene: DetailScene) -> SampledViews:
    """Sample the octaves of brightness within each view."""
    how, some = scene.how, scene.sample
    sizes, quotients = [], []
    for bands, sigma_px in scene.pixels.octaves(scene.maps()[:, [QUOTIENT, LIT]], how.sigmas_px):
        quotient, change = bands.T
        window_px = max(sigma_px, how.least_shading_window_px)
        size = scene.pixels.mean((change * scene.response) ** 2, window_px)
        sizes.append(size[some])
        quotients.append((quotient / scene.noise_scale[:, 0])[some])
        if len(sizes) == len(how.noise.texture_spectrum):
            break
    return SampledViews(tuple(sizes), tuple(quotients))
