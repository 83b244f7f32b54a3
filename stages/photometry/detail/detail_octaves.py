"""Octaves of the residual of a smooth albedo, filtered by the uncertainty of shading and noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stages.photometry.detail.noise_estimation import relative_noise, relative_noise_variance
from stages.photometry.detail.octaves import KnownPixels
from stages.photometry.detail.other_views import OtherViews
from stages.photometry.detail.part_of_scene import PartOfScene
from stages.photometry.detail.scene_statistics import DetailStatistics, SampledOctave, SampledViews
from stages.photometry.detail.settings import DetailSettings
from stages.photometry.detail.shading_uncertainty import (
    ShownChange,
    log_quotient,
    log_shading,
    uncertain_energy,
)
from stages.photometry.detail.texture_limit import TextureLimit
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.pixelwise import pixelwise

TINY = 1e-12  # against division by 0, of squares
AXES, QUOTIENT, LIT = slice(0, 3), 3, 4  # columns of `DetailScene.maps`


@dataclass(frozen=True, eq=False)
class DetailScene:
    """Photos with their model; fields as the arguments of `with_detail`; `light`: S, `explained`: ρ S."""

    views: StackedViews
    image: np.ndarray
    light: np.ndarray
    explained: np.ndarray
    trusted: np.ndarray
    how: DetailSettings
    part: PartOfScene
    known: DetailStatistics | None = None

    @cached_property
    def pixels(self) -> KnownPixels:
        """The trusted pixels."""
        return KnownPixels.of(self.views, self.trusted)

    @cached_property
    def others(self) -> OtherViews:
        """The correspondences of the trusted pixels."""
        return OtherViews.of(self.views, self.trusted)

    @cached_property
    def seen_by_others(self) -> KnownPixels:
        """Trusted pixels with correspondences in other views."""
        return KnownPixels.of(self.views, self.others.count > 0)

    @cached_property
    def noise_scale(self) -> np.ndarray:
        """Noise relative to that at median brightness, (N, 3)."""
        offset, typical, how = self.how.log_offset, self.part.typical.noise, self.how.noise

        def relative(explained: np.ndarray) -> np.ndarray:
            return relative_noise(relative_noise_variance(explained, offset), typical, how)

        return pixelwise(relative, self.explained)

    @cached_property
    def response(self) -> np.ndarray:
        """Derivative of ``log(I + d)`` by log shading, (N,): small in dark pixels."""
        offset = self.how.log_offset
        return pixelwise(lambda explained: (explained / (explained + offset)).mean(axis=1), self.explained)

    @cached_property
    def sample(self) -> np.ndarray:
        """Indices of the pixels that uncertainty and noise are estimated from."""
        return np.flatnonzero(self.trusted & self.part.sampled(self.how.sample_pixels))

    @property
    def measured_and_linked(self) -> tuple[int, int]:
        """Number of trusted pixels that are measured, and of those of them with correspondences."""
        measured = self.trusted & self.part.own
        return int(np.count_nonzero(measured)), int(np.count_nonzero(self.others.count[measured]))

    def maps(self) -> np.ndarray:
        """Compute axes of the residual, mean logarithm of I/S, mean logarithm of S: (N, 5)."""
        offset, most = self.how.log_offset, self.how.largest_residual

        def columns(image: np.ndarray, explained: np.ndarray, light: np.ndarray) -> np.ndarray:
            left = axes_of(np.clip(log_quotient(image, explained, offset), -most, most))
            quotient = log_quotient(image, light, offset).mean(axis=1)
            return np.column_stack([left, quotient, log_shading(light)]).astype(np.float32)

        return pixelwise(columns, self.image, self.explained, self.light)


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
        Of the bands before the reduction; without what `kept` adds, energies and what is local to them.
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
    def of(cls, scene: DetailScene, number: int, bands: np.ndarray, sigma_px: float) -> DetailOctave:
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
        shown = sample.shown(how) if scene.known is None else scene.known.octaves[number].shown
        if shown is not None:
            lost, size = pixelwise(shown.reduction, change, stated)
            left[:, 0] -= lost
        wide_px = max(how.window * sigma_px, how.least_window_px)
        return cls(scene, left, change, size, stated, shown, wide_px, sample)

    def with_differences(self, coarser: np.ndarray) -> DetailOctave:
        """Sample the differences between views; `coarser`: the band of log I/S in the next octave."""
        scene, some = self.scene, self.scene.sample
        some = some[scene.others.count[some] > 0]
        of_both = scene.noise_scale[some] * np.sqrt(1 + 1 / scene.others.count[some])[:, None]
        difference = (self.left - self.left_by_others)[some] / of_both
        # of brightness, which has the least noise
        texture = scene.pixels.mean_of(np.square, coarser, sigma_px=self.wide_px)
        return replace(self, sample=replace(self.sample, difference=difference, texture=texture[some]))

    @cached_property
    def left_by_others(self) -> np.ndarray:
        """Mean of `left` in other views, (N, 3)."""
        return self.scene.others.mean(self.left)

    def kept(
        self, error: float, noise: np.ndarray, limit: TextureLimit | None
    ) -> tuple[np.ndarray, np.ndarray, SampledOctave]:
        """Filter the band.

        Returns
        -------
        tuple of ndarray, shape (N, 3), ndarray, shape (N,), and SampledOctave
            The kept albedo, the expected variance of its first axis, and the sample, whose limit of texture
            is used where none is given.
        """
        scene, how, others = self.scene, self.scene.how, self.scene.others
        power, some = how.energy_power, scene.sample
        band, noise = self._fused(noise.astype(np.float32))

        def powers(
            band: np.ndarray, noise: np.ndarray, size: np.ndarray, change: np.ndarray, stated: np.ndarray
        ) -> np.ndarray:
            return np.column_stack([np.abs(band) ** power, noise, size, band[:, 0] * change, stated])

        def shared(means: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            energy = means[:, :3] ** (2 / power) / how.energy_of_normal
            return np.column_stack([energy, means[:, 3:8]]), means[:, 8].copy()

        def filtered(
            band: np.ndarray, means: np.ndarray, change: np.ndarray, trusted: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            uncertain = uncertain_energy(error, means[:, 6], means[:, 3:6], how)
            return found.filtered(band, means[:, :3].copy(), uncertain, change, trusted)

        of_pixels = band, noise, self.size, self.change, self.stated
        means = scene.pixels.mean_of(powers, *of_pixels, sigma_px=self.wide_px)
        del noise  # frees memory
        means, stated = pixelwise(shared, means)  # of all views; of each alone
        means = others.with_own(means)
        wide = stated[some]
        sample = replace(
            self.sample,
            energy=means[some, :3],
            wide_noise=means[some, 3:6],
            wide_size=means[some, 6],
            wide_product=means[some, 7],
            wide_stated=wide,
            wide_excess=np.zeros_like(wide) if self.shown is None else self.shown.at(wide),
        )
        found = limit or sample.limit(error, self.shown, how)
        kept, expected = pixelwise(filtered, band, means, stated, scene.trusted)
        return kept, expected, sample

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


def axes_of(logs: np.ndarray) -> np.ndarray:
    """Convert logarithms of channels, (N, 3), to mean logarithm, log R/G and log B/G, (N, 3)."""
    red, green, blue = logs.T
    return np.stack([logs.mean(axis=1), red - green, blue - green], axis=1)


def channels_of(axes: np.ndarray) -> np.ndarray:
    """Invert `axes_of`."""
    mean, red, blue = axes.T
    green = mean - (red + blue) / 3
    return np.stack([green + red, green, green + blue], axis=1)
