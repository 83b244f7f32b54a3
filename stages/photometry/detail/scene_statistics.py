"""Statistics of a scene by which the detail of its albedo is filtered, the same for all of its pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from stages.photometry.detail.noise_estimation import noise_between_views, noise_of_one_view
from stages.photometry.detail.octaves import response_to_noise
from stages.photometry.detail.settings import DetailSettings
from stages.photometry.detail.shading_uncertainty import (
    ShadingUncertainty,
    ShownChange,
    error_of_change,
    uncertain_energy,
)
from stages.photometry.detail.texture_limit import TextureLimit

CHROMA_NOISE = 6.0  # variance of log R/G, 2 σ², over that of the mean logarithm, σ²/3, for equal noise in all


@dataclass(frozen=True, eq=False)
class SampledOctave:
    """One octave of sampled pixels: what its statistics are computed from.

    Attributes
    ----------
    number : int
        0 is the finest.
    sigma_px : float
        Its upper σ.
    change : ndarray, shape (n,)
        Band of the log shading, times the response of ``log(I + d)``.
    left : ndarray, shape (n, 3)
        Band of the residual, in its axes.
    quotient : ndarray, shape (n,)
        Band of log I/S.
    stated : ndarray, shape (n,)
        Local mean square of `change`.
    difference : ndarray, shape (m, 3)
        Of the reduced residual between a view and the mean of the others, over the noise's relative
        deviation; of pixels with correspondences, in the finest octaves, else m = 0.
    texture : ndarray, shape (m,)
        Local mean square of log I/S in the next octave.
    energy : ndarray, shape (n, 3)
        Local energy of the reduced residual, fused with that of other views, over a pixel and its
        correspondences; as are the next two.
    wide_noise : ndarray, shape (n, 3)
        Local mean of the noise's variance.
    wide_size : ndarray, shape (n,)
        Local mean square of the shading's change, after the reduction.
    wide_stated : ndarray, shape (n,)
        Local mean of `stated`, in the pixel's own view.
    wide_product : ndarray, shape (n,)
        Local mean of the fused residual's first axis times `change`.
    wide_excess : ndarray, shape (n,)
        The excess (`ShownChange`) by which the shading's change was reduced, at `wide_stated`.
    """

    number: int
    sigma_px: float
    change: np.ndarray
    left: np.ndarray
    quotient: np.ndarray
    stated: np.ndarray
    difference: np.ndarray
    texture: np.ndarray
    energy: np.ndarray
    wide_noise: np.ndarray
    wide_size: np.ndarray
    wide_stated: np.ndarray
    wide_product: np.ndarray
    wide_excess: np.ndarray

    @classmethod
    def joined(cls, several: Sequence[SampledOctave]) -> SampledOctave:
        """Join those of parts of a scene."""
        names = [field.name for field in fields(cls) if field.name not in ("number", "sigma_px")]
        arrays = (np.concatenate([getattr(one, name) for one in several]) for name in names)
        return cls(several[0].number, several[0].sigma_px, *arrays)

    def shown(self, how: DetailSettings) -> ShownChange | None:
        """Compute how much of the shading's change the photos show; None in the coarse octaves."""
        if self.number >= how.uncertainty.compared_octaves:
            return None
        finer_px = 0.0 if self.number == 0 else self.sigma_px / 2
        return ShownChange.of(self.change, self.left[:, 0], self.stated, finer_px, how)

    def error_of_change(self, shown: ShownChange | None, how: DetailSettings) -> float:
        """Estimate κ, within its bounds, after the reduction of the shading's change to what is shown."""
        left, quotient, size = self.left[:, 0], self.quotient, self.stated
        if shown is not None:
            lost, size = shown.reduction(self.change, self.stated)
            left, quotient = left - lost, quotient - lost
        found, limits = error_of_change(size, quotient, left, how), how.uncertainty
        return float(np.clip(found, limits.least[self.number], limits.most))

    def noise(self, how: DetailSettings) -> np.ndarray:
        """Estimate the noise of this band at median brightness, (3,), from differences between views."""
        axes = self.difference.T
        return np.array([noise_between_views(axis, self.texture, how.classes) for axis in axes])

    def limit(self, error: float, shown: ShownChange | None, how: DetailSettings) -> TextureLimit:
        """Find the limit of texture, of the energy beyond that which κ, `error`, and noise explain.

        Of a joined sample, κ and what is shown are of all. Each part has reduced its residual r to what is
        shown there, by e h, h the change, e its excess. By the excess f of all, the residual is
        ``r + (e − f) h``: its energy differs by ``2 (e − f) r h + (e − f)² h²``.
        """
        energy, size = self.energy, self.wide_size
        if shown is not None:
            excess = shown.at(self.wide_stated)
            other = self.wide_excess - excess
            first = energy[:, 0] + 2 * other * self.wide_product + other**2 * self.wide_stated
            energy = np.column_stack([np.maximum(first, 0), energy[:, 1:]])
            size = size + ((1 + excess) ** 2 - (1 + self.wide_excess) ** 2) * self.wide_stated
            size = np.maximum(size, 0)
        uncertain = uncertain_energy(error, size, self.wide_noise, how)
        return TextureLimit.of(np.maximum(energy - uncertain, 0), self.wide_stated, how)


@dataclass(frozen=True, eq=False)
class SampledViews:
    """Octaves of brightness within each view, of sampled pixels: noise where correspondences are few.

    Attributes
    ----------
    sizes, quotients : tuple of ndarray, shape (n,)
        As `noise_of_one_view` takes them.
    """

    sizes: tuple[np.ndarray, ...]
    quotients: tuple[np.ndarray, ...]

    @classmethod
    def joined(cls, several: Sequence[SampledViews]) -> SampledViews:
        """Join those of parts of a scene."""
        return cls(
            tuple(np.concatenate(parts) for parts in zip(*(one.sizes for one in several), strict=True)),
            tuple(np.concatenate(parts) for parts in zip(*(one.quotients for one in several), strict=True)),
        )

    def noise(self, how: DetailSettings) -> np.ndarray:
        """Estimate the noise of a pixel in the three axes, (3,)."""
        alone = noise_of_one_view(list(self.sizes), list(self.quotients), how)
        return alone * np.sqrt([1, CHROMA_NOISE, CHROMA_NOISE])


@dataclass(frozen=True, eq=False)
class SampledDetail:
    """What the statistics of a scene, or of a part of it, are computed from.

    Attributes
    ----------
    octaves : tuple of SampledOctave
        Finest first.
    alone : SampledViews or None
        Where correspondences are few.
    between_views : float
        Mean square difference of log albedo between views.
    measured, linked : int
        Trusted pixels that were measured, and those of them with correspondences.
    """

    octaves: tuple[SampledOctave, ...]
    alone: SampledViews | None
    between_views: float
    measured: int
    linked: int

    @classmethod
    def joined(cls, several: Sequence[SampledDetail]) -> SampledDetail:
        """Join those of parts of a scene: samples of all, the mean of differences between views."""
        linked = np.array([one.linked for one in several], float)
        alone = [one.alone for one in several if one.alone is not None]
        by_octave = zip(*(one.octaves for one in several), strict=True)
        return cls(
            tuple(SampledOctave.joined(octave) for octave in by_octave),
            SampledViews.joined(alone) if alone else None,
            float(
                np.average([one.between_views for one in several], weights=linked if linked.any() else None)
            ),
            sum(one.measured for one in several),
            int(linked.sum()),
        )


def has_few_links(measured: int, linked: int, how: DetailSettings) -> bool:
    """Whether so few pixels have correspondences that noise is measured within single views."""
    return linked / max(measured, 1) < how.noise.linked_share


@dataclass(frozen=True, eq=False)
class OctaveStatistics:
    """Statistics of one octave.

    Attributes
    ----------
    shown : ShownChange or None
        How much of the shading's change the photos show; None where it is not compared.
    of_change : float
        κ, the standard deviation of the shading's error over its own local change.
    noise : ndarray, shape (3,)
        Standard deviation of white noise in a pixel, in three axes.
    limit : TextureLimit
    """

    shown: ShownChange | None
    of_change: float
    noise: np.ndarray
    limit: TextureLimit


@dataclass(frozen=True, eq=False)
class DetailStatistics:
    """Statistics of all octaves, finest first, and of the pixels; see `SampledDetail`."""

    octaves: tuple[OctaveStatistics, ...]
    between_views: float

    @classmethod
    def of(cls, sample: SampledDetail, how: DetailSettings) -> DetailStatistics:
        """Compute the statistics of a sample."""
        few = has_few_links(sample.measured, sample.linked, how)
        noise = OctaveNoise.of(sample.alone if few else None, how)
        found = []
        for octave in sample.octaves:
            shown = octave.shown(how)
            deviation, error = noise.at(octave), octave.error_of_change(shown, how)
            found.append(OctaveStatistics(shown, error, deviation, octave.limit(error, shown, how)))
        return cls(tuple(found), sample.between_views)

    @property
    def uncertainty(self) -> ShadingUncertainty:
        """Summarise for records."""
        shown = tuple(1.0 if one.shown is None else one.shown.shown for one in self.octaves)
        noise = np.max([one.noise for one in self.octaves], axis=0)
        return ShadingUncertainty(shown, tuple(one.of_change for one in self.octaves), tuple(noise.tolist()))


@dataclass(frozen=True, eq=False)
class OctaveNoise:
    """Noise of a pixel, octave by octave, finest first: measured in the finest, assumed white beyond.

    Attributes
    ----------
    measured : ndarray, shape (m, 3)
        Of the finest octaves, as far as they were asked for.
    by_views : bool
        Whether they are measured between views, or known from single views.
    """

    measured: np.ndarray
    by_views: bool
    how: DetailSettings

    @classmethod
    def of(cls, alone: SampledViews | None, how: DetailSettings) -> OctaveNoise:
        """Begin with the noise of single views, where it was sampled."""
        measured = np.zeros((how.noise.compared_octaves, 3))
        if alone is not None:
            measured[:] = alone.noise(how)
        return cls(measured, alone is None, how)

    def at(self, octave: SampledOctave) -> np.ndarray:
        """Measure the noise of an octave, (3,), or take the greatest of the finer ones."""
        number = octave.number
        if number >= len(self.measured):
            return self.measured.max(axis=0)
        if self.by_views:
            self.measured[number] = octave.noise(self.how) / response_to_noise(self.how.sigmas_px)[number]
        return self.measured[number].copy()
