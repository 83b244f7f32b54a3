"""One octave of what a photo shows beyond a smooth albedo: what of it the light could have done."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stages.photometry.detail.noise_estimation import grain_of, noise_between_views, noise_of_one_view
from stages.photometry.detail.octaves import KnownPixels
from stages.photometry.detail.other_views import OtherViews
from stages.photometry.detail.shading_uncertainty import (
    DARK,
    FINE,
    ShownChange,
    error_of_change,
    log_quotient,
    log_shading,
)
from stages.photometry.stack import StackedViews

STRONGEST = 1.0  # of the logarithm: what differs by more (glints, shadows that are not there) is cut to this
POWER = 1.5  # of the sizes that an energy is the mean of: between lone borders for little and for all
OF_NORMAL = 0.9035  # (mean |x|^1.5)^(2/1.5) of normal deviates x of variance 1
TWICE = 2.0  # times its own energy: what a shading's change in the wrong place leaves behind, here and there
EVENER = 0.5  # of the pixels: those in whose shading paint is told from light
BOLDEST = 0.99  # of these: texture that is stronger than where light is even is a shadow's border
TOLD_BY = 300_000  # pixels at most that the doubt is told from
ALONE = 5  # octaves by which noise is told where views see nothing of one another
CHROMA_NOISE = 6.0  # variance of log R/G and log B/G over that of the mean logarithm, for equal noise in all
AXES, QUOTIENT, LIT = slice(0, 3), 3, 4  # columns of `DetailScene.maps`


@dataclass(frozen=True)
class DetailSettings:
    """How far the shading may be doubted; see the settings of the stage.

    Attributes
    ----------
    least_doubt : tuple of float
        Per octave, share of the shading's own change.
    most_doubt : float
        In all octaves.
    chroma : float
        Of that, what its colour may be wrong by.
    level : float
        What is coarser than all octaves may be wrong by, of the logarithm.
    window : float
        σ of the surroundings that energies are averaged over, in σ of the octave.
    """

    least_doubt: tuple[float, ...]
    most_doubt: float
    chroma: float
    level: float
    window: float

    @property
    def of_axes(self) -> np.ndarray:
        """Doubt of mean logarithm, log R/G and log B/G over that of the first."""
        return np.array([1.0, self.chroma, self.chroma], np.float32)


@dataclass(frozen=True, eq=False)
class DetailScene:
    """What detail is told from; fields as the arguments of `with_detail`; `explained`: ρ S."""

    views: StackedViews
    image: np.ndarray
    light: np.ndarray
    explained: np.ndarray
    trusted: np.ndarray
    settings: DetailSettings

    @cached_property
    def pixels(self) -> KnownPixels:
        """Those that are trusted."""
        return KnownPixels.of(self.views, self.trusted)

    @cached_property
    def others(self) -> OtherViews:
        """What the trusted pixels are linked to."""
        return OtherViews.of(self.views, self.trusted)

    @cached_property
    def seen_by_others(self) -> KnownPixels:
        """Pixels whose surface other views see, too."""
        return KnownPixels.of(self.views, self.others.count > 0)

    @cached_property
    def grain(self) -> np.ndarray:
        """How noise depends on brightness, (N, 3); see `grain_of`."""
        return grain_of(self.explained)

    @cached_property
    def response(self) -> np.ndarray:
        """How much of a change of the light's logarithm shows in ``log(I + d)``: little where it is dark."""
        return (self.explained / (self.explained + DARK)).mean(axis=1)

    @cached_property
    def told_by(self) -> np.ndarray:
        """Numbers of the pixels that the doubt is told from."""
        trusted = np.flatnonzero(self.trusted)
        return trusted[:: max(1, -(-len(trusted) // TOLD_BY))]

    @cached_property
    def maps(self) -> np.ndarray:
        """Axes of what is left, mean logarithm of I/S, and of S: (N, 5)."""
        left = axes_of(np.clip(log_quotient(self.image, self.explained), -STRONGEST, STRONGEST))
        quotient = log_quotient(self.image, self.light).mean(axis=1)
        return np.column_stack([left, quotient, log_shading(self.light)]).astype(np.float32)


@dataclass(frozen=True, eq=False)
class DetailOctave:
    """One octave of a scene, the shading taken for what the photos show of it.

    Attributes
    ----------
    scene : DetailScene
    left : ndarray, shape (N, 3)
        Band of what is left, its axes.
    quotient : ndarray, shape (N,)
        Band of log I/S.
    size, stated : ndarray, shape (N,)
        Local mean square of the shading's band as it is taken, and as it was found.
    shown : float
        Share of the shading's change that is taken, on average.
    wide_px : float
        σ of the surroundings that energies are averaged over.
    """

    scene: DetailScene
    left: np.ndarray
    quotient: np.ndarray
    size: np.ndarray
    stated: np.ndarray
    shown: float
    wide_px: float

    @classmethod
    def of(cls, scene: DetailScene, number: int, bands: np.ndarray, sigma_px: float) -> DetailOctave:
        """Compare the shading's change with the photos, in the fine octaves, and correct it."""
        left, quotient, change = bands[:, AXES].copy(), bands[:, QUOTIENT], bands[:, LIT] * scene.response
        stated = size = scene.pixels.mean(change**2, max(sigma_px, 1.0))
        shown, told = 1.0, scene.told_by
        if number < FINE:
            finer_px = 0.0 if number == 0 else sigma_px / 2
            compared = ShownChange.of(change[told], left[told, 0], stated[told], finer_px)
            excess = compared.at(stated)
            left[:, 0] -= excess * change
            quotient = quotient - excess * change
            size, shown = (1 + excess) ** 2 * stated, compared.shown
        wide_px = max(scene.settings.window * sigma_px, 1.5)
        return cls(scene, left, quotient, size, stated, shown, wide_px)

    def error_of_change(self) -> float:
        """Estimate κ, as far as the scene tells it."""
        told = self.scene.told_by
        return error_of_change(self.size[told], self.quotient[told], self.left[told, 0])

    def noise(self, coarser: np.ndarray) -> np.ndarray:
        """Estimate the noise in this band at median brightness, (3,), by what views do not share.

        `coarser`: the band of log I/S in the next octave.
        """
        scene, told = self.scene, self.scene.told_by
        told = told[scene.others.count[told] > 0]
        of_both = scene.grain[told] * np.sqrt(1 + 1 / scene.others.count[told])[:, None]
        difference = (self.left - self.left_by_others)[told] / of_both
        texture = scene.pixels.mean(coarser**2, self.wide_px)[told]  # of brightness: that has least noise
        return np.array([noise_between_views(axis, texture) for axis in difference.T])

    @cached_property
    def left_by_others(self) -> np.ndarray:
        """Mean of `left` in other views, (N, 3)."""
        return self.scene.others.mean(self.left)

    def kept(self, error: float, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Estimate what of the band is albedo, (N, 3), and the expected variance of its first axis, (N,)."""
        scene, settings, others = self.scene, self.scene.settings, self.scene.others
        band, noise = self._fused(np.square(noise.astype(np.float32) * scene.grain))
        of_axes = settings.of_axes**2
        doubted = error**2 * self.size[:, None] * of_axes + noise
        misplaced = TWICE * scene.pixels.mean(self.stated, self.wide_px)[:, None] * of_axes
        energy = scene.pixels.mean(np.abs(band) ** POWER, self.wide_px) ** (2 / POWER) / OF_NORMAL
        energy = others.with_own(energy)
        doubted = others.with_own(scene.pixels.mean(doubted, self.wide_px))
        signal = np.maximum(energy - doubted, 0)
        told = scene.told_by
        even = told[self.size[told] <= np.quantile(self.size[told], EVENER)] if told.size else told
        boldest = np.quantile(signal[even], BOLDEST, axis=0) if even.size else np.zeros(3)
        signal = np.minimum(signal, np.maximum(boldest, energy - misplaced))
        share = signal / np.maximum(energy, 1e-12)
        expected = share**2 * doubted + (1 - share) ** 2 * energy
        return np.where(scene.trusted[:, None], share * band, 0), expected[:, 0]

    def _fused(self, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The band with that of the other views averaged in, and the variance of its noise, (N, 3) each.

        Others are as noisy, over their number; and misplaced by what they differ by beyond noise. Either is
        weighed by its variance.
        """
        others = self.scene.others
        if not (others.count.any() and noise.any()):
            return self.left, noise
        count = np.maximum(others.count, 1)[:, None]
        difference = np.where(others.count[:, None] > 0, self.left_by_others - self.left, 0)
        apart = self.scene.seen_by_others.mean(difference**2, self.wide_px)
        of_others = noise / count + np.maximum(apart - noise * (1 + 1 / count), 0)
        weight = np.where(others.count[:, None] > 0, noise / np.maximum(noise + of_others, 1e-12), 0)
        return self.left + weight * difference, (1 - weight) ** 2 * noise + weight**2 * of_others


def noise_without_others(scene: DetailScene) -> np.ndarray:
    """Estimate the noise of the three axes from the octaves of brightness, every view by itself, (3,)."""
    sizes, quotients, told = [], [], scene.told_by
    for bands, sigma_px in scene.pixels.octaves(scene.maps[:, [QUOTIENT, LIT]]):
        quotient, change = bands.T
        sizes.append(scene.pixels.mean((change * scene.response) ** 2, max(sigma_px, 1.0))[told])
        quotients.append((quotient / scene.grain[:, 0])[told])
        if len(sizes) == ALONE:
            break
    return noise_of_one_view(sizes, quotients) * np.sqrt([1, CHROMA_NOISE, CHROMA_NOISE])


def axes_of(logs: np.ndarray) -> np.ndarray:
    """Convert logarithms of channels, (N, 3), to mean logarithm, log R/G and log B/G."""
    red, green, blue = logs.T
    return np.stack([logs.mean(axis=1), red - green, blue - green], axis=1)


def channels_of(axes: np.ndarray) -> np.ndarray:
    """Convert back what `axes_of` made."""
    mean, red, blue = axes.T
    green = mean - (red + blue) / 3
    return np.stack([green + red, green, green + blue], axis=1)
