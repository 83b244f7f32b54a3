"""The albedo's detail: what the photo shows beyond a smooth albedo, but for what the light could have done.

Per octave and colour axis, a Wiener filter: what is left over, against how far the shading is to be doubted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from stages.photometry.observations import UNLIT
from stages.photometry.octaves import KnownPixels, response_to_noise
from stages.photometry.other_views import OtherViews, noise_between_views
from stages.photometry.shading_doubt import (
    DARK,
    FINE,
    ShadingDoubt,
    ShownChange,
    error_of_change,
    grain_of,
    log_quotient,
    log_shading,
    noise_of_one_view,
)
from stages.photometry.stack import StackedViews

STRONGEST = 1.0  # of the logarithm: what differs by more (glints, shadows that are not there) is cut to this
POWER = 1.5  # of the sizes that an energy is the mean of: between lone borders for little and for all
OF_NORMAL = 0.9035  # (mean |x|^1.5)^(2/1.5) of normal deviates x of variance 1
TWICE = 2.0  # times its own energy: what a shading's change in the wrong place leaves behind, here and there
EVENER = 0.5  # of the pixels: those in whose shading paint is told from light
BOLDEST = 0.99  # of these: texture that is stronger than where light is even is a shadow's border
TOLD_BY = 300_000  # pixels at most that the doubt is told from
MEASURED = 2  # octaves in which views are compared for noise; in coarser ones it is white
AXES, QUOTIENT, LIT = slice(0, 3), 3, 4  # columns of `_Scene.maps`
ALONE = 5  # octaves by which noise is told where views see nothing of one another
CHROMA_NOISE = 6.0  # variance of log R/G and log B/G over that of the mean logarithm, for equal noise in all
AROUND_PX = 1.5  # σ of the surroundings whose differences are told of a pixel
LEFT_OVER = 0.25  # of the square of what the smooth albedo leaves over: expected to be wrong, kept or not
LEAST_RESPONSE = 0.1  # of a pixel's logarithm to light: what is darker is as doubtful as that
OF_CHANGE = 0.05  # of the square of the shading's change in every octave: what its error is where it is large
LINKED = 0.2  # share of the pixels that other views must see for their differences to tell the noise


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
class Detail:
    """What comes back.

    Attributes
    ----------
    albedo : ndarray, shape (N, 3), float32
    variance : ndarray, shape (N,), float32
        Of the albedo's mean logarithm, that is expected: its square root is the relative error.
    doubt : ShadingDoubt
    """

    albedo: np.ndarray
    variance: np.ndarray
    doubt: ShadingDoubt


def with_detail(
    views: StackedViews,
    albedo: np.ndarray,
    image: np.ndarray,
    shading: np.ndarray,
    trusted: np.ndarray,
    settings: DetailSettings,
) -> Detail:
    """Give a smooth albedo the detail that the photo has and the light cannot have made.

    Parameters
    ----------
    views : StackedViews
    albedo : ndarray, shape (N, 3)
        As far as it is known by smoothness and other views.
    image, shading : ndarray, shape (N, 3)
        Scaled, without gloss.
    trusted : ndarray, shape (N,), bool
        Pixels whose data count; the others keep their albedo.
    settings : DetailSettings

    Notes
    -----
    ``ρ + (ρ + d/S) (exp(Σ_k g_k r_k) − 1)``: r = log (I + d)/(ρ S + d), d = 0.01, as mean logarithm, log R/G
    and log B/G, divided into octaves r_k; I/S where all g_k are 1. In every octave:

    1. The shading's own change is taken for as much as the photos show of it, `ShownChange`.
    2. r_k of the other views is averaged in, as far as noise is more than what views see misplaced.
    3. ``g_k = max(0, 1 − U/E)``: E the local variance of r_k, by the mean of |r_k|^1.5, U that of
       what noise and the shading's error, ``κ² L²``, make of it (`ShadingDoubt`).
    4. Beyond ``2 L²``, which a shadow in the wrong place can make, all of E may be paint; below, no more than
       hardly any surface has where light is even.

    Where the photo differs from the smooth albedo by no more than doubt, the smooth albedo stands; where by
    much more, the photo divided by its shading does; between, by degrees.

    The variance adds up what is expected of every octave, ``g² U + (1 − g)² E``; of the light where it
    changes much, a twentieth of L²; a quarter of the square of what the smooth albedo left over around; and
    what the albedos of different views differ by.
    """
    light = np.maximum(shading, UNLIT * max(float(np.median(shading)), 1e-6))
    detailed = np.maximum(albedo, 0).astype(np.float32)
    explained = detailed * light
    scene = _Scene(views, image, light, explained, trusted, settings)
    kept, variance, doubt = _kept(scene)
    added = (explained + DARK) * np.expm1(_channels_of(kept)) / light
    detailed = np.where(trusted[:, None], np.maximum(detailed + added, 0), detailed).astype(np.float32)
    variance = variance / np.maximum(scene.response, LEAST_RESPONSE) ** 2
    return Detail(detailed, (variance + _apart(scene, detailed)).astype(np.float32), doubt)


def _apart(scene: _Scene, albedo: np.ndarray) -> np.ndarray:
    """Mean square of what the logarithm of the albedo differs by from that of other views, around, (N,).

    Where no other view sees the surface, as much as elsewhere: that nobody contradicts is no proof.
    """
    logs = np.log(albedo.mean(axis=1, keepdims=True) + DARK).astype(np.float32)
    seen = scene.others.count > 0
    if not seen.any():
        return np.zeros(len(albedo), np.float32)
    difference = np.where(seen, (logs - scene.others.mean(logs))[:, 0], 0)
    apart = scene.seen_by_others.mean(difference**2, AROUND_PX)
    return np.where(seen, apart, apart[seen].mean())


@dataclass(frozen=True, eq=False)
class _Scene:
    """What detail is told from; arguments as of `with_detail`."""

    views: StackedViews
    image: np.ndarray
    light: np.ndarray
    explained: np.ndarray
    trusted: np.ndarray
    settings: DetailSettings

    @cached_property
    def pixels(self) -> KnownPixels:
        return KnownPixels.of(self.views, self.trusted)

    @cached_property
    def others(self) -> OtherViews:
        return OtherViews.of(self.views, self.trusted)

    @cached_property
    def seen_by_others(self) -> KnownPixels:
        return KnownPixels.of(self.views, self.others.count > 0)

    @cached_property
    def grain(self) -> np.ndarray:
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
        left = _axes_of(np.clip(log_quotient(self.image, self.explained), -STRONGEST, STRONGEST))
        quotient = log_quotient(self.image, self.light).mean(axis=1)
        return np.column_stack([left, quotient, log_shading(self.light)]).astype(np.float32)


def _kept(scene: _Scene) -> tuple[np.ndarray, np.ndarray, ShadingDoubt]:
    """What of the three axes is albedo, (N, 3), its expected variance, and the doubt."""
    settings = scene.settings
    noise = np.zeros((2, 3))
    if scene.others.share < LINKED:
        noise[:] = _noise_of_one_view(scene)
    maps = scene.maps
    kept = np.zeros((len(maps), 3), np.float32)
    variance = settings.level**2 + LEFT_OVER * scene.pixels.mean(maps[:, 0] ** 2, AROUND_PX)
    shown, of_change = [], []
    octaves = enumerate(pairwise(scene.pixels.octaves(maps)))
    for number, ((bands, sigma_px), (coarser, _)) in octaves:
        octave = _Octave.of(scene, number, bands, sigma_px)
        shown.append(octave.shown)
        of_change.append(
            float(np.clip(octave.error_of_change(), settings.least_doubt[number], settings.most_doubt))
        )
        if number < MEASURED and scene.others.share >= LINKED:
            noise[number] = octave.noise(coarser[:, QUOTIENT]) / response_to_noise()[number]
        deviation = noise[number] if number < MEASURED else noise.max(axis=0)
        own, expected = octave.kept(of_change[-1], deviation * response_to_noise()[number])
        kept += own
        variance += expected + OF_CHANGE * octave.stated
        rest = coarser[:, AXES]
    kept += rest * _share_of_signal(rest**2, (settings.level * settings.of_axes) ** 2)
    doubt = ShadingDoubt(tuple(shown), tuple(of_change), tuple(noise.max(axis=0).tolist()))
    return kept, variance, doubt


@dataclass(frozen=True, eq=False)
class _Octave:
    """One octave of a scene, the shading taken for what the photos show of it.

    Attributes
    ----------
    scene : _Scene
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

    scene: _Scene
    left: np.ndarray
    quotient: np.ndarray
    size: np.ndarray
    stated: np.ndarray
    shown: float
    wide_px: float

    @classmethod
    def of(cls, scene: _Scene, number: int, bands: np.ndarray, sigma_px: float) -> _Octave:
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
        """κ, as far as the scene tells it."""
        told = self.scene.told_by
        return error_of_change(self.size[told], self.quotient[told], self.left[told, 0])

    def noise(self, coarser: np.ndarray) -> np.ndarray:
        """Standard deviation of noise in this band at median brightness, (3,), by what views do not share.

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
        return self.scene.others.mean(self.left)

    def kept(self, error: float, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What of the band is albedo, (N, 3), and the variance of its first axis that is expected, (N,)."""
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


def _noise_of_one_view(scene: _Scene) -> np.ndarray:
    """Noise of the three axes, from the octaves of brightness in every view by itself."""
    sizes, quotients, told = [], [], scene.told_by
    for bands, sigma_px in scene.pixels.octaves(scene.maps[:, [QUOTIENT, LIT]]):
        quotient, change = bands.T
        sizes.append(scene.pixels.mean((change * scene.response) ** 2, max(sigma_px, 1.0))[told])
        quotients.append((quotient / scene.grain[:, 0])[told])
        if len(sizes) == ALONE:
            break
    return noise_of_one_view(sizes, quotients) * np.sqrt([1, CHROMA_NOISE, CHROMA_NOISE])


def _share_of_signal(energy: np.ndarray, doubted: np.ndarray) -> np.ndarray:
    """Share of a value that is signal: its variance without the doubt's, over all of it."""
    return np.maximum(0, 1 - doubted / np.maximum(energy, 1e-12)).astype(np.float32)


def _axes_of(logs: np.ndarray) -> np.ndarray:
    """Mean logarithm, log R/G and log B/G of the channels' logarithms, (N, 3)."""
    red, green, blue = logs.T
    return np.stack([logs.mean(axis=1), red - green, blue - green], axis=1)


def _channels_of(axes: np.ndarray) -> np.ndarray:
    """The way back from `_axes_of`."""
    mean, red, blue = axes.T
    green = mean - (red + blue) / 3
    return np.stack([green + red, green, green + blue], axis=1)
